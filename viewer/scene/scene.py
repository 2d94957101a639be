"""Ground, character, model, camera and quality: loads them while the old ones stay in use, and moves the character."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from runtime.assets import character_file, model_name
from runtime.character.guess import JointsUnknown
from runtime.character.joint_map import joint_map_path
from runtime.character.shape import BodyShape, shaped_file
from runtime.controls import Controls
from runtime.motion.controller import Controller
from runtime.motion.snapshot import Snapshot
from runtime.pose import FPS, Pose
from runtime.prompts.gpt.settings import GptSettings
from runtime.safe_read import expanded
from runtime.session.character_files import read_character_files, write_character_files
from runtime.session.session import CharacterChoice, Ground, ModelName, Session
from runtime.takes.input_recording import InputRecorder
from runtime.takes.metadata import origin_of
from runtime.takes.pinned import bent_pose
from runtime.takes.pins import weights_at
from runtime.terrain.files import SUFFIXES as GROUNDS
from runtime.terrain.height_map import Terrain
from viewer.editor import Editor
from viewer.input.bindings import VIEW_ACTIONS, Action
from viewer.jobs import Jobs, Slot
from viewer.live.link import LiveLink
from viewer.live.vmc import VmcLink
from viewer.messages import Messages
from viewer.render.looks import dressed
from viewer.render.terrain_pass import MEADOW_SLOPE_RATIO
from viewer.scene.camera_control import VIEWS, CameraControl, start_yaw
from viewer.scene.joint_mapping import JointMapping
from viewer.scene.simulation import Simulation, make_pose
from viewer.services import Loaded, Services
from viewer.settings import Settings

MANNEQUIN, WALKER = SHIPPED = "mannequin", "walker"  # shipped characters
SIMULATION, WAY = "simulation", "way"  # topics of messages
LoadedCharacter = tuple[CharacterChoice, Path | None, Any]  # with its file and content
SLOW_FPS, SLOW_SECONDS = 20.0, 5.0  # below this frame rate for this long, automatic quality is lowered


@dataclass
class Scene:
    """The scene: ground, character, model, camera and quality, kept in line with the session."""

    editor: Editor
    settings: Settings
    messages: Messages
    jobs: Jobs
    services: Services
    ctx: Any  # OpenGL context
    renderer: Any
    inputs: InputRecorder  # records changes of the controller
    shown: Callable[[], Pose]  # the pose in view: the live one, or that of a take
    folder: Path  # the state folder: files of characters and of reshaped mannequins
    camera: CameraControl = field(default_factory=CameraControl)
    # the live ground, at the character's scale
    terrain: Terrain = field(default_factory=Terrain.flat)
    simulation: Simulation = field(init=False)
    terrain_names: tuple[str, ...] = ()
    file_path: str = ""  # of the path field
    loading: str = ""  # the ground being loaded
    model_name: str = ""  # "" while loading
    provider: str = ""
    model_folder: Path | None = None  # last request; None for the default
    character_path: Path | None = None  # the file of the character in use; None for the default mannequin
    _character: Any = None
    _choice: CharacterChoice = field(default_factory=CharacterChoice)  # in use, or being loaded
    _first_view: str = ""
    _seen: Ground | None = None
    _drawn: Terrain | None = None
    _slow_s: float = 0.0
    joints: JointMapping = field(init=False)
    live: LiveLink = field(init=False)
    vmc: VmcLink = field(init=False)

    def __post_init__(self) -> None:
        self.simulation = Simulation.standing(self.terrain)
        self.joints = JointMapping(self.messages, self.jobs, self.open_character)
        self.live = LiveLink(self.messages)
        self.vmc = VmcLink(self.messages)
        self.editor.followers.append(self.follow)

    @property
    def controller(self) -> Controller | None:
        return self.simulation.controller

    @property
    def terrain_spec(self) -> str:
        ground = self.editor.session.ground
        return "" if ground is None else ground.spec

    @property
    def ground(self) -> Ground:
        """The live ground at the character's scale."""
        if self._seen is None or self._seen.terrain is not self.terrain:
            self._seen = Ground.of(self.terrain_spec, self.terrain)
        return self._seen

    @property
    def now(self) -> float:
        """The time (seconds) at which live pins are in force, from the start of the program."""
        return self.inputs.next_frame / FPS

    def bend(self, pose: Pose, now: float) -> Pose:
        """Return the live pose with the pins in force; the same object if there are none."""
        pins = weights_at(self.editor.session.live.poses.pins, now)
        if not pins:
            return pose
        hips, local, contacts = bent_pose(pose.hips_position, pose.local_rotations, pose.contacts, pins)
        return make_pose(hips, local, contacts, float(pose.root_position[1]), pose.root_yaw)

    def follow(self, before: Session, now: Session) -> None:
        """Apply the session's ground and character, and remember them for the next start."""
        if now.ground is not None and now.ground != before.ground:
            self._put_ground(now.ground)
            done = self._specs()[: self.editor.history.at + 1]
            ready = [spec for spec in done if spec in self.terrain_names]
            self.settings.terrain = ready[-1] if ready else self.settings.terrain
        if now.character != self._choice and not self.editor.dragging:
            self._load_choice(now.character)
        if now.character != before.character:
            self.settings.character = self.character_name or now.character.path

    def _specs(self) -> list[str]:
        """Return the grounds of the session's steps, undone ones included, oldest first."""
        grounds = [step.session.ground for step in self.editor.history.steps]
        return ["" if ground is None else ground.spec for ground in grounds]

    @property
    def grounds(self) -> list[str]:
        """The available grounds: the shipped ones, and files that this session has used."""
        return list(dict.fromkeys([*self.terrain_names, *filter(None, self._specs())]))

    @property
    def actions(self) -> dict[Action, Callable[[], None]]:
        return {
            Action.RESET: self.reset_character,
            Action.CAMERA: lambda: self.use_camera("orbit" if self.camera.mode == "follow" else "follow"),
            Action.FRAME: self.frame_character,
            **{action: partial(self.view, name) for action, name in zip(VIEW_ACTIONS, VIEWS, strict=True)},
            Action.TRAJECTORY: partial(self._toggle, "show_trajectory"),
            Action.SKELETON: partial(self._toggle, "show_skeleton"),
            Action.CONTACTS: partial(self._toggle, "show_contacts"),
            Action.GRID: partial(self._toggle, "show_grid"),
        }

    @property
    def files(self) -> dict[str, Callable[[Path], None]]:
        return dict.fromkeys(GROUNDS, self.load_terrain)

    def _toggle(self, name: str) -> None:
        setattr(self.settings, name, not getattr(self.settings, name))

    def use_camera(self, mode: str) -> None:
        """Use the follow or orbit camera, now and at the next start."""
        self.camera.use(mode)
        self.settings.camera = mode

    def begin(self, camera: str, live_link: str | None, vmc: str | None) -> None:
        """Show the first ground with a camera (follow, orbit, or a view), and start the live links. Raises UsageError."""
        self.terrain_names = self.services.terrain_names()
        self._first_view = camera if camera in VIEWS else ""
        self.camera.use("orbit" if self._first_view else camera)
        self.renderer.set_terrain(self.terrain)
        self.live.begin(live_link)
        self.vmc.begin(vmc)

    def view(self, name: str) -> None:
        """Show the character from a view of `VIEWS`."""
        self.camera.view(VIEWS[name], self.shown())
        self.settings.camera = self.camera.mode

    def frame_character(self) -> None:
        self.camera.frame_character(self.shown())

    def advance(self, seconds: float, controls: Controls) -> list[Pose]:
        """Advance the character by `seconds`; return the new poses, before pins."""
        self._keep_size()
        simulation = self.simulation
        if simulation.controller is not None:
            simulation.controller.temperature = self.settings.temperature
            simulation.controller.strength = self.settings.strength
            simulation.controller.response = self.settings.response
        poses = simulation.advance(seconds, controls)
        first = self.inputs.next_frame
        shown = [self.bend(pose, (first + i) / FPS) for i, pose in enumerate(poses)]
        self.live.publish(shown, size=self.terrain.unit_m)
        self.vmc.on_root = self.settings.vmc_root
        self.vmc.publish(shown)
        if simulation.problem:
            self.inputs.forget()
            self.messages.error(simulation.problem, SIMULATION)
        elif poses:
            self.messages.settle(SIMULATION)
            if simulation.blocked:
                self.messages.warn(simulation.blocked, WAY)
            else:
                self.messages.settle(WAY)
        return poses

    def reset_character(self) -> None:
        """Return the character to the start, with character and camera facing the first obstacles."""
        yaw = start_yaw(self.terrain)
        self.put_character(0.0, 0.0, yaw)
        self.camera.open_at(self.simulation.current, yaw, self.terrain.steepest > MEADOW_SLOPE_RATIO)
        if self._first_view:
            self.camera.view(VIEWS[self._first_view], self.simulation.current)

    def put_character(self, x: float, z: float, yaw: float) -> None:
        """Place the character at a position (metres, radians); the camera stays."""
        if self.controller is not None:
            self.inputs.mark_restart(x, z, yaw)
            self.simulation.reset(x, z, yaw)
        else:
            self.simulation = Simulation.standing(self.terrain, yaw)
        self.camera.lose_track()

    # --- loading

    def load_terrain(self, name: str | Path) -> None:
        """Load a terrain by name or file and use it; the old one stays until then."""
        spec = str(expanded(name)) if str(name).startswith("~") else str(name)
        self.loading = spec
        self.jobs.submit(
            Slot("terrain"), partial(self.read_ground, spec), partial(self._take_terrain, spec),
            lambda _: setattr(self, "loading", ""), reading=Path(spec).name,
        )  # fmt: skip

    def read_ground(self, spec: str) -> Terrain:
        """Load a ground by name or file; thread-safe. Raises TerrainError, FileError."""
        return self.services.load_terrain(
            spec, self.settings.height_map_cell_m, self.settings.height_map_height_m
        )

    def draw_ground(self, terrain: Terrain) -> None:
        """Draw a ground, such as that of the playing take; the live character's ground stays."""
        if terrain is not self._drawn:
            self.renderer.set_terrain(terrain)
            self._drawn = terrain

    def _take_terrain(self, spec: str, terrain: Terrain) -> None:
        self.loading = ""
        ground, known = Ground.of(spec, terrain), self.editor.session.ground is not None
        set_ground = partial(replace, ground=ground)
        if known:
            self.editor.do(f"ground {Path(spec).name}", set_ground)
        else:
            self.editor.amend(set_ground)
        self.reset_character()
        if terrain.note or known:
            self.messages.note(terrain.note or f"Ground: {terrain.name}.")

    def _put_ground(self, ground: Ground) -> None:
        """Put the character, at its present place, on a ground at its own scale."""
        terrain = ground.terrain.seen_by(self.size)
        self.draw_ground(terrain)
        self.terrain = terrain
        self.inputs.mark_ground(ground.spec, terrain)
        if self.controller is not None:
            self.controller.set_terrain(terrain)

    @property
    def size(self) -> float:
        """Metres per unit of the scene, which uses the scale of the character's own size."""
        fitted = self.settings.fit_to_motion or self._character is None
        return 1.0 if fitted else float(getattr(self._character, "size", 1.0))

    def _keep_size(self) -> None:
        """Rescale the ground when the character's size changes; the character keeps its place in the world."""
        ground, size = self.terrain, self.size
        if ground.unit_m == size:
            return
        by, pose = ground.unit_m / size, self.simulation.current
        x, _, z = map(float, pose.root_position)
        self._put_ground(Ground.of(self.terrain_spec, ground))
        self.put_character(x * by, z * by, pose.root_yaw)

    def go_on_from(self, snapshot: Snapshot, pose: Pose) -> None:
        """Continue with the live character from a state of a take; the session already has the take's ground."""
        if self.controller is None:
            return
        snapshot.restore(self.controller)
        self.simulation.go_on_from(pose)
        self.inputs.forget()

    # --- characters

    def open_character(self, path: Path | None, joint_map: Path | None = None, step: bool = True) -> None:
        """Load the character of a file, or the mannequin for None; `step`: as a step of undo.

        `joint_map` replaces the one in the file's folder. The session stores the file's content.
        """

        def take(loaded: LoadedCharacter) -> None:
            choice, _, _ = loaded
            self._take_character(*loaded)
            change = partial(replace, character=choice)
            if step:
                self.editor.do(f"character {path.name if path else 'mannequin'}", change)
            else:
                self.editor.amend(change)

        self._load_character(partial(self.read_character, path, joint_map), take, path)

    def _load_choice(self, choice: CharacterChoice) -> None:
        """Show the session's character from the session's own files."""
        self._choice, load = choice, partial(self.read_choice, choice)
        self._load_character(load, lambda loaded: self._take_character(*loaded), None)

    def read_character(self, path: Path | None, joint_map: Path | None = None) -> LoadedCharacter:
        """Load the character of a file together with the content to store in the session; thread-safe. Raises FileError."""
        character = self.services.load_character(path, joint_map, "")
        if path is None:
            return CharacterChoice(), None, character
        files = read_character_files(path)
        if joint_map is not None:
            files[joint_map_path(Path(next(iter(files)))).name] = joint_map.read_bytes()
        cache = self.editor.file.cache
        kept = write_character_files(files, cache)
        choice = CharacterChoice(path=str(path), key=kept.relative_to(cache).as_posix())
        return choice, path, character

    def read_choice(self, choice: CharacterChoice) -> LoadedCharacter:
        """Load a character of the session; thread-safe. Raises FileError."""
        path = self.editor.file.character_path(choice)
        if choice.shape != BodyShape():
            path = shaped_file(choice.shape, self.folder / "shapes")
        return choice, path, self.services.load_character(path, None, choice.unit)

    def _load_character(
        self, load: Callable[[], Any], take: Callable[[Any], None], path: Path | None
    ) -> None:
        self.jobs.submit(
            Slot("character"), load, take, lambda error: self._refuse_character(path, error),
            reading=path.name if path else "",
        )  # fmt: skip

    def set_shape(self, shape: BodyShape, held: bool = False) -> None:
        """Change the mannequin's shape; `held` during a drag, after which it is built."""
        change = self.editor.drag if held else self.editor.do
        change("shape of the mannequin", partial(replace, character=CharacterChoice(shape)))

    @property
    def character_name(self) -> str:
        """Name of the shipped character in use, or "" for a file."""
        choice = self.editor.session.character
        if not choice.key:
            return MANNEQUIN
        return WALKER if choice.path == str(character_file(WALKER)) else ""

    def _refuse_character(self, path: Path | None, error: Exception) -> None:
        """Open the joint mapping for a character whose joints could not be guessed."""
        self._choice = self.editor.session.character
        self.joints.refused(error)
        if path is not None and isinstance(error, JointsUnknown) and self.joints.shown != path:
            self.joints.begin(path)
        elif path is not None and self._character is None:  # at the start: somebody must be seen
            self._load_choice(self._choice)

    def _take_character(self, choice: CharacterChoice, path: Path | None, character: Any) -> None:
        self.renderer.set_character(dressed(character, self.settings.look))
        self._choice, self._character, self.character_path = choice, character, path
        if choice.path and choice.path != str(character_file(WALKER)):
            self.messages.note(
                f"Character {Path(choice.path).name} loaded. {getattr(character, 'note', '')}".rstrip()
            )
        if self.joints.path == path or path is None:
            self.joints.close()
        elif self.joints.open:
            self.joints.begin(path)  # otherwise it would list the joints of the previous character

    # --- model and quality

    def load_model(
        self,
        directory: Path | None,
        seed: int,
        gpt: GptSettings | None,
        done: Callable[[Loaded], None],
        failed: Callable[[], None],
    ) -> None:
        """Load a model, with `gpt` to answer prompts; the first character stands still until then."""

        def take(loaded: Loaded) -> None:
            self.use_model(loaded)
            done(loaded)

        def fail(_: Exception) -> None:
            self.model_folder = before
            failed()

        terrain, before = self.terrain, self.model_folder
        self.model_folder = directory
        self.jobs.submit(
            Slot("model"), lambda: self.services.load_model(directory, terrain, seed, gpt), take, fail
        )

    def use_model(self, loaded: Loaded) -> None:
        """Use a loaded model for the character."""
        loaded.controller.set_terrain(self.terrain)  # it may have changed while the model was loading
        first = self.controller is None
        self.simulation.use(loaded.controller)
        if first:
            self.reset_character()
        self.inputs.forget()
        self.model_name, self.provider = loaded.name, loaded.provider
        origin, folder = origin_of(loaded.controller, ""), self.model_folder
        named = "" if folder is None else model_name(folder) or str(folder)
        model = ModelName(named, origin.model, origin.model_sha256, int(origin.seed or 0))
        self.editor.amend(partial(replace, model=model))

    def set_quality(self, name: str) -> None:
        """Use another quality preset; "" for the one suited to this machine."""
        self._render_with(name)
        self.settings.quality = name

    def set_look(self, look: str) -> None:
        """Change the look of the character."""
        self.settings.look = look
        if self._character is not None:
            self.renderer.set_character(dressed(self._character, look))

    def lower_quality(self, fps: float, dt: float) -> None:
        """Switch to the fast preset if the frame rate stays too low on a CPU renderer and the user chose no preset."""
        slow = not self.settings.quality and self.renderer.quality.name == "software" and 0.0 < fps < SLOW_FPS
        self._slow_s = self._slow_s + dt if slow else 0.0
        if self._slow_s > SLOW_SECONDS:
            self._render_with("fast")
            self.messages.note("Rendering is slow: quality was set to “Fast”. Change it in Scene.")

    def _render_with(self, name: str) -> None:
        renderer = self.services.make_renderer(self.ctx, name)
        renderer.set_terrain(self.terrain)
        if self._character is not None:
            renderer.set_character(dressed(self._character, self.settings.look))
        self.renderer.release()
        self.renderer = renderer
