// A take in a page: three.js plays the GLB that the page holds. Written for `runtime.formats.page`, which fills the page.
"use strict";
(() => {
  const by = (id) => document.getElementById(id);
  const facts = JSON.parse(by("facts").textContent);
  const state = { seconds: 0, playing: !matchMedia("(prefers-reduced-motion: reduce)").matches, speed: 1, camera: "front", ready: false };
  window.take = state;

  const renderer = (() => {
    try { return new THREE.WebGLRenderer({ canvas: by("view"), antialias: true }); }
    catch { by("trouble").textContent = "This browser shows no 3D (WebGL). Another browser, or one with graphics turned on, plays the take."; throw new Error("no WebGL"); }
  })();
  renderer.shadowMap.enabled = true;
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(38, 1, 0.05, 300);
  const orbit = new THREE.OrbitControls(camera, by("view"));
  orbit.enableDamping = true;
  orbit.maxDistance = 40;
  scene.add(new THREE.HemisphereLight(0xffffff, 0x8899aa, 1.6));
  const sun = new THREE.DirectionalLight(0xffffff, 2.2);
  sun.castShadow = true;
  sun.shadow.mapSize.set(2048, 2048);
  for (const side of ["left", "bottom"]) sun.shadow.camera[side] = -4;
  for (const side of ["right", "top"]) sun.shadow.camera[side] = 4;
  sun.shadow.bias = -0.0005;
  sun.shadow.normalBias = 0.02;
  scene.add(sun, sun.target);

  let changed = true; // since the last picture
  orbit.addEventListener("change", () => { changed = true; });
  const players = []; // {root, mixer, hips, seconds}
  const middle = new THREE.Vector3(), before = new THREE.Vector3(), toward = new THREE.Vector3();

  async function bytes(text) {
    const raw = atob(text.trim()), array = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k++) array[k] = raw.charCodeAt(k);
    const stream = new Blob([array]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  }

  function start(gltf, name) {
    gltf.animations.forEach((animation, k) => {
      const root = k === 0 ? gltf.scene : THREE.clone(gltf.scene);
      const shift = (k - (gltf.animations.length - 1) / 2) * 1.6 * (gltf.animations.length > 1 ? 1 : 0);
      root.position.x = shift;
      root.traverse((node) => {
        if (!node.isMesh) return;
        const ground = node.name === "Ground";
        node.castShadow = !ground;
        node.receiveShadow = true;
        node.frustumCulled = false;
        if (ground && k > 0) node.visible = false;
        if (ground) { node.position.x -= shift; node.material.color.set(0x9aa3a0); }
      });
      const mixer = new THREE.AnimationMixer(root);
      mixer.clipAction(animation).play();
      let hips = null;
      root.traverse((node) => { if (!hips && node.name === name) hips = node; });
      players.push({ root, mixer, hips: hips || root, seconds: animation.duration }); // a shorter take waits at its end
      scene.add(root);
    });
    pose(0);
    before.copy(middle);
    choose("front");
    state.ready = true;
    renderer.setAnimationLoop(frame);
  }

  function pose(seconds) {
    state.seconds = Math.min(Math.max(seconds, 0), facts.seconds);
    for (const player of players) player.mixer.setTime(Math.min(state.seconds, player.seconds - 1e-4));
    scene.updateMatrixWorld(true);
    middle.set(0, 0, 0);
    for (const player of players) middle.add(player.hips.getWorldPosition(toward));
    middle.divideScalar(players.length || 1);
    sun.position.set(middle.x + 3, middle.y + 6, middle.z + 4);
    sun.target.position.copy(middle);
    changed = true;
  }

  function heading() {
    const q = facts.yaw[Math.min(Math.round(state.seconds * facts.fps), facts.yaw.length - 1)];
    return q || 0;
  }

  const views = { front: [2.7, 0.16, 4.1], side: [Math.PI / 2, 0.12, 3.9], back: [0, 0.22, 4], top: [0, 1.45, 6], free: null };
  function choose(name) {
    state.camera = name;
    for (const button of by("cameras").children) button.setAttribute("aria-pressed", button.dataset.name === name);
    if (!views[name]) return;
    const [turn, pitch, away] = views[name], yaw = heading() + turn;
    const far = away * (1 + 0.35 * (players.length - 1)) * Math.max(1, 1.15 / camera.aspect);
    orbit.target.copy(middle).y -= 0.06;
    camera.position.set(
      orbit.target.x - Math.sin(yaw) * Math.cos(pitch) * far,
      orbit.target.y + Math.sin(pitch) * far,
      orbit.target.z - Math.cos(yaw) * Math.cos(pitch) * far);
    before.copy(middle);
    orbit.update();
  }

  let last = performance.now();
  function frame(now) {
    const dt = Math.min((now - last) / 1000, 0.1);
    last = now;
    if (state.playing) pose(state.seconds + dt * state.speed > facts.seconds ? 0 : state.seconds + dt * state.speed);
    toward.copy(middle).sub(before); // the camera goes along with the walker
    if (toward.length() < 2) { camera.position.add(toward); orbit.target.add(toward); } else if (views[state.camera]) choose(state.camera);
    before.copy(middle);
    orbit.update();
    if (!changed) return; // a page that stands still costs nothing
    changed = false;
    renderer.render(scene, camera);
    show();
  }
  state.picture = () => { renderer.render(scene, camera); return by("view").toDataURL("image/png"); };

  function show() {
    const index = Math.round(state.seconds * facts.fps);
    if (document.activeElement !== by("scrub") || state.playing) by("scrub").value = index;
    by("time").textContent = `${state.seconds.toFixed(2)} of ${facts.seconds.toFixed(2)} s · frame ${index}`;
    by("play").textContent = state.playing ? "Pause" : "Play";
    const words = facts.markers.filter((m) => m.kind === "prompt" && m.seconds <= state.seconds + 1e-6).pop();
    const text = words ? `“${words.name}”` : "";
    if (by("words").textContent !== text) by("words").textContent = text;
  }

  function feet() {
    const canvas = by("feet"), ratio = devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    const brush = canvas.getContext("2d"), style = getComputedStyle(document.documentElement);
    brush.fillStyle = style.getPropertyValue("--foot");
    const step = canvas.width / facts.contacts.length, row = canvas.height / 2;
    [...facts.contacts].forEach((bits, k) => {
      if (bits & 1) brush.fillRect(k * step, 0, step + 1, row - ratio);
      if (bits & 2) brush.fillRect(k * step, row, step + 1, row - ratio);
    });
  }

  function size() {
    const box = by("view").getBoundingClientRect(), below = document.querySelector("footer").offsetHeight;
    renderer.setPixelRatio(Math.min(devicePixelRatio || 1, 2));
    renderer.setSize(box.width, box.height, false);
    camera.aspect = box.width / box.height;
    camera.setViewOffset(box.width, box.height, 0, below / 2, box.width, box.height);
    camera.updateProjectionMatrix();
    changed = true;
    feet();
  }

  function theme(name) {
    document.documentElement.dataset.theme = name;
    by("theme").textContent = name === "dark" ? "Light" : "Dark";
    scene.background = new THREE.Color(name === "dark" ? 0x141a22 : 0xe9edf2);
    changed = true;
    feet();
  }
  const turn = () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  const play = () => { state.playing = !state.playing; show(); };
  const step = (frames) => { state.playing = false; pose(state.seconds + frames / facts.fps); show(); };

  Object.keys(views).forEach((name, k) => {
    const button = document.createElement("button");
    button.textContent = name[0].toUpperCase() + name.slice(1);
    button.dataset.name = name;
    button.title = `Camera: ${k + 1}`;
    button.onclick = () => choose(name);
    by("cameras").append(button, " ");
  });
  for (const marker of facts.markers.filter((m) => m.kind === "prompt")) {
    const button = document.createElement("button");
    button.textContent = marker.name;
    button.title = `${marker.name}: ${marker.seconds.toFixed(1)} s`;
    button.style.left = `${(100 * marker.seconds) / Math.max(facts.seconds, 1e-6)}%`;
    button.onclick = () => { pose(marker.seconds); show(); };
    by("marks").append(button);
  }
  by("scrub").max = facts.contacts.length - 1;
  by("scrub").oninput = (event) => { state.playing = false; pose(event.target.value / facts.fps); show(); };
  by("play").onclick = play;
  by("back").onclick = () => step(-1);
  by("on").onclick = () => step(1);
  by("theme").onclick = turn;
  by("speed").onchange = (event) => { state.speed = Number(event.target.value); };
  orbit.addEventListener("start", () => choose("free"));
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    const keys = { " ": play, ",": () => step(-1), ".": () => step(1), ArrowLeft: () => step(-1), ArrowRight: () => step(1),
      Home: () => step(-1e9), End: () => step(1e9), t: turn, T: turn };
    Object.keys(views).forEach((name, k) => { keys[String(k + 1)] = () => choose(name); });
    if (event.key in keys && !(event.key === " " && event.target.tagName === "BUTTON")) { event.preventDefault(); keys[event.key](); }
  });
  addEventListener("resize", size);
  theme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  size();
  show();
  (async () => {
    const gltf = await new THREE.GLTFLoader().parseAsync(await bytes(by("glb").textContent), "");
    start(gltf, (await gltf.parser.getDependency("node", facts.hips)).name);
    size();
    choose("front");
  })().catch((error) => { by("trouble").textContent = `The take cannot be shown: ${error.message || error}`; });
})();
