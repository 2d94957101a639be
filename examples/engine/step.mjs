// The network's step in JavaScript: onnxruntime-web in Node and in the browser. docs/engine.md has the layout of x and y.

export const LAYOUT = { // shapes of the parts of y, in order
  path: [6, 2], facing: [6, 2], joints: [31, 3], velocities: [31, 3], root: [3], contacts: [4], phase: [7, 5, 2],
  rotations: [31, 6],
};

/** The arrays of a NumPy .npz that is not compressed: {name: {shape, data}}. An Error of one sentence for anything else. */
export function readNpz(buffer) {
  try {
    return readArrays(buffer);
  } catch (error) {
    throw new Error(`The arrays are damaged (${error.message}): download the file again.`);
  }
}

function readArrays(buffer) {
  const view = new DataView(buffer), arrays = {}, text = new TextDecoder("latin1");
  for (let at = 0; view.getUint32(at, true) === 0x04034b50;) {
    if (view.getUint16(at + 8, true) !== 0) throw new Error("a compressed .npz");
    const named = view.getUint16(at + 26, true), extra = view.getUint16(at + 28, true);
    const name = text.decode(new Uint8Array(buffer, at + 30, named)), start = at + 30 + named + extra;
    let size = view.getUint32(at + 18, true); // 64-bit sizes stand in the extra field
    if (size === 0xffffffff) size = Number(view.getBigUint64(at + 30 + named + 12, true));
    if (crc32(new Uint8Array(buffer, start, size)) !== view.getUint32(at + 14, true)) throw new Error(`checksum of ${name}`);
    const head = 10 + view.getUint16(start + 8, true);
    const header = text.decode(new Uint8Array(buffer, start + 10, head - 10));
    const [, type] = header.match(/'descr': '<(\w+)'/), [, sizes] = header.match(/'shape': \(([^)]*)\)/);
    const data = buffer.slice(start + head, start + size);
    arrays[name.replace(/\.npy$/, "")] = {
      shape: sizes.split(",").filter((n) => n.trim()).map(Number),
      data: type === "f2" ? Float32Array.from(new Uint16Array(data), half)
        : new { f4: Float32Array, f8: Float64Array, i4: Int32Array }[type](data),
    };
    at = start + size;
  }
  return arrays;
}

function crc32(bytes) {
  let crc = -1;
  for (const byte of bytes) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) crc = (crc >>> 1) ^ (0xedb88320 & -(crc & 1));
  }
  return ~crc >>> 0;
}

/** An Error unless `bytes` are the graph of this name that the model's metadata.json (its bytes) tells the SHA-256 of. */
export async function checkGraph(metadata, name, bytes) {
  let told;
  try {
    told = JSON.parse(new TextDecoder().decode(metadata)).sha256[name];
  } catch (error) {
    throw new Error(`metadata.json is damaged (${error.message}): download the model again.`);
  }
  const found = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
  if (Array.from(found, (byte) => byte.toString(16).padStart(2, "0")).join("") !== told)
    throw new Error(`${name}.onnx is not the graph that metadata.json tells of: download the model again.`);
}

function half(bits) {
  const sign = bits >> 15 ? -1 : 1, exponent = (bits >> 10) & 31, fraction = (bits & 1023) / 1024;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction) : 2 ** -14 * fraction);
}

/** A character's network: `style` and `step` are the bytes of the graphs, `z` is Z^t as 384 numbers. */
export async function openNetwork(ort, style, step, z) {
  const folder = await ort.InferenceSession.create(style);
  const folded = await folder.run({ z: new ort.Tensor("float32", Float32Array.from(z), [6, 64]) });
  const session = await ort.InferenceSession.create(step);
  const weights = {};
  for (const name of ["front_bias", "content_weight", "content_bias"])
    weights[name] = new ort.Tensor("float32", folded[name].data, [1, ...folded[name].dims]);
  return { ort, session, weights, speeds: folded.speeds.data };
}

/** y (473 numbers) of an input x (472 numbers) and noise (5 x 8 x 473 numbers, standard normal times the temperature). */
export async function step({ ort, session, weights }, x, noise) {
  const feeds = { x: new ort.Tensor("float32", x, [1, 472]), noise: new ort.Tensor("float32", noise, [1, 5, 8, 473]) };
  return (await session.run({ ...feeds, ...weights })).y.data;
}

/** The named parts of y, flat. */
export function split(y) {
  let at = 0;
  return Object.fromEntries(Object.entries(LAYOUT).map(([name, shape]) => {
    const size = shape.reduce((a, b) => a * b);
    return [name, y.subarray(at, (at += size))];
  }));
}

/** Runs the golden steps: the largest difference in y, the milliseconds of a step, and the joints of each. */
export async function check(ort, style, graph, golden) {
  for (const name of ["x", "y", "z", "noise"]) if (!golden[name]) throw new Error(`The golden steps lack ${name}: download the file again.`);
  const network = await openNetwork(ort, style, graph, golden.z.data);
  const count = golden.x.shape[0], noises = golden.noise.data.length / count;
  let worst = 0, joints = [];
  const run = (k) => step(network, golden.x.data.slice(472 * k, 472 * (k + 1)), golden.noise.data.slice(noises * k, noises * (k + 1)));
  for (let k = 0; k < count; k++) {
    const y = await run(k);
    y.forEach((value, i) => (worst = Math.max(worst, Math.abs(value - golden.y.data[473 * k + i]))));
    joints.push(Array.from(split(y).joints));
  }
  const begun = performance.now();
  for (let k = 0; k < 10; k++) await run(k % count);
  return { worst, milliseconds: (performance.now() - begun) / 10, joints };
}
