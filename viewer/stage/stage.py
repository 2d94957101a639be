"""Ground, character, model, camera and quality: loading them without losing the ones in use, and moving the character."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from runtime.character.guess import JointsUnknown
from runtime.character.read import SUFFIXES as GLTF_SUFFIXES
from runtime.character.shape import BodyShape, shaped_file
from runtime.controls import Controls
from runtime.motion.paths import PlanarPose
from runtime.motion.snapshot import Snapshot
from runtime.pose import FPS, Pose
from runtime.prompts.gpt.settings import GptSettings
from runtime.takes.drive import DriveRecorder, GroundChange
from runtime.terrain.files import SUFFIXES as GROUNDS
from runtime.terrain.height_map import Terrain
from viewer.input.bindings import VIEW_ACTIONS, Action
from viewer.jobs import Jobs, Slot
from viewer.live.link import LiveLink
from viewer.live.vmc import VmcLink
from viewer.messages import Messages
from viewer.services import Loaded, Services
from viewer.settings import Settings
from viewer.stage.camera_control import CameraControl
from viewer.stage.joint_mapping import JointMapping
from viewer.stage.live_pins import LivePins
from viewer.stage.path_tool import PathTool
from viewer.stage.simulation import Simulation
from viewer.stage.state import StageState
from viewer.stage.views import VIEWS, start_yaw

SIMULATION, WAY = "simulation", "way"  # topics of messages
SLOW_FPS, SLOW_SECONDS = 20.0, 5.0  # fewer frames a second for so long, and automatic quality goes down


@dataclass
class Stage:
    """Actions of the scene panel."""

    state: StageState
    settings: Settings
    messages: Messages
    jobs: Jobs
    services: Services
    ctx: Any  # OpenGL context
    renderer: Any
    drives: DriveRecorder  # hears what changes the controller
    shown: Callable[[], Pose]  # the pose in view: the live one, or that of a take
    cache: Path  # folder for files of the mannequin in other shapes
    camera: CameraControl = field(default_factory=CameraControl)
    pins: LivePins = field(default_factory=LivePins)
    character_path: Path | None = None
    _character: Any = None
    _shape_file: Path | None = None  # of the mannequin in another shape
    _first_view: str = ""
    _drawn: Terrain | None = None
    _slow_s: float = 0.0
    path: PathTool = field(init=False)
    joints: JointMapping = field(init=False)
    live: LiveLink = field(init=False)
    vmc: VmcLink = field(init=False)

    def __post_init__(self) -> None:
        self.path = PathTool(self.messages)
        self.joints = JointMapping(self.messages, self.jobs, self.load_character)
        self.live = LiveLink(self.messages)
        self.vmc = VmcLink(self.messages)

    @property
    def actions(self) -> dict[Action, Callable[[], None]]:
        """What keys and buttons do here."""
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
        """What opens a file, by its suffix."""
        grounds = {suffix: self._load_ground for suffix in GROUNDS}
        return {**grounds, **dict.fromkeys(GLTF_SUFFIXES, self._open_gltf)}

    def _toggle(self, name: str) -> None:
        setattr(self.settings, name, not getattr(self.settings, name))

    def use_camera(self, mode: str) -> None:
        """Follow or orbit, now and at the next start."""
        self.camera.use(mode)
        self.settings.camera = mode

    def begin_camera(self, name: str) -> None:
        """The camera of a start: follow, orbit, or a view."""
        self._first_view = name if name in VIEWS else ""
        self.camera.use("orbit" if self._first_view else name)

    def view(self, name: str) -> None:
        """Look at the character from a place of `VIEWS`."""
        self.camera.view(VIEWS[name], self.shown())
        self.settings.camera = self.camera.mode

    def frame_character(self) -> None:
        """Bring the whole character into the middle."""
        self.camera.frame_character(self.shown())

    def advance(self, seconds: float, controls: Controls) -> list[Pose]:
        """Let time pass for the character; the new poses, without what pins do to them."""
        self._keep_size()
        simulation = self.state.simulation
        if simulation.controller is not None:
            simulation.controller.temperature = self.settings.temperature
            simulation.controller.strength = self.settings.strength
            simulation.controller.response = self.settings.response
        poses = simulation.advance(seconds, controls)
        first = self.drives.next_frame
        shown = [self.pins.bend(pose, (first + i) / FPS) for i, pose in enumerate(poses)]
        self.live.publish(shown, size=self.state.terrain.unit_m)
        self.vmc.publish(shown)
        if simulation.problem:
            self.drives.forget()
            self.messages.error(simulation.problem, SIMULATION)
        elif poses:
            self.messages.settle(SIMULATION)
            if simulation.blocked:
                self.messages.warn(simulation.blocked, WAY)
            else:
                self.messages.settle(WAY)
        return poses

    def controls(self, own: Controls, dt: float) -> Controls:
        """The user's controls, or those of the path that is walked."""
        pose = self.state.simulation.current
        place = PlanarPose(float(pose.root_position[0]), float(pose.root_position[2]), pose.root_yaw)
        return self.path.controls(own, place, dt)

    def reset_character(self) -> None:
        """Put the character back to the start; it and the camera look at what there is to walk over."""
        yaw = start_yaw(self.state.terrain)
        self.put_character(0.0, 0.0, yaw)
        self.camera.open_at(self.state.simulation.current, yaw)
        if self._first_view:
            self.camera.view(VIEWS[self._first_view], self.state.simulation.current)

    def put_character(self, x: float, z: float, yaw: float) -> None:
        """Let the character stand at a place (metres, radians); the camera stays where it is put."""
        if self.state.controller is not None:
            self.drives.mark_restart(x, z, yaw)
            self.state.simulation.reset(x, z, yaw)
        else:
            self.state.simulation = Simulation.standing(self.state.terrain, yaw)
        self.camera.lose_track()

    # --- loading

    def load_terrain(self, spec: str) -> None:
        """Show and walk on a terrain, by name or file; the old one stays until the new one is there."""
        spec = str(Path(spec).expanduser()) if spec.startswith("~") else spec
        self.state.loading = spec
        cell, height = self.settings.height_map_cell_m, self.settings.height_map_height_m
        self.jobs.submit(
            Slot("terrain"),
            lambda: self.services.load_terrain(spec, cell, height),
            lambda terrain: self._take_terrain(spec, terrain),
            lambda _: self._stop_loading(),
            reading=Path(spec).name,
        )

    def read_ground(self, spec: str) -> Terrain:
        """A ground by name or file, on any thread; TerrainError, FileError."""
        return self.services.load_terrain(
            spec, self.settings.height_map_cell_m, self.settings.height_map_height_m
        )

    def draw_ground(self, terrain: Terrain) -> None:
        """Draw a ground, that of a take while it plays; the one under the character stays what it is."""
        if terrain is not self._drawn:
            self.renderer.set_terrain(terrain)
            self._drawn = terrain

    def _load_ground(self, path: Path) -> None:
        self.load_terrain(str(path))

    def _take_terrain(self, spec: str, terrain: Terrain) -> None:
        self._stop_loading()
        known = bool(self.state.terrain_spec)  # not the first one
        self.show_ground(spec, terrain)
        if spec in self.state.terrain_names:
            self.settings.terrain = spec
        self.reset_character()
        if terrain.note or known:
            self.messages.note(terrain.note or f"Ground: {terrain.name}.")

    def show_ground(self, spec: str, terrain: Terrain) -> None:
        """Put a ground under the character where it stands, as large as its body sees it."""
        terrain = terrain.seen_by(self.size)
        self.draw_ground(terrain)
        self.state.terrain, self.state.terrain_spec = terrain, spec
        self.drives.mark_ground(spec, terrain)
        if self.state.controller is not None:
            self.state.controller.set_terrain(terrain)

    @property
    def size(self) -> float:
        """Metres of a metre of the scene: it is drawn and walked in the lengths of the character's own size."""
        fitted = self.settings.fit_to_motion or self._character is None
        return 1.0 if fitted else float(getattr(self._character, "size", 1.0))

    def _keep_size(self) -> None:
        """Let the ground follow when the size changes; the character stays in its place of the world."""
        ground, size = self.state.terrain, self.size
        if ground.unit_m == size:
            return
        by, pose = ground.unit_m / size, self.state.simulation.current
        self.show_ground(self.state.terrain_spec, ground)
        self.put_character(
            float(pose.root_position[0]) * by, float(pose.root_position[2]) * by, pose.root_yaw
        )

    def go_on_from(self, snapshot: Snapshot, pose: Pose, ground: GroundChange | None) -> None:
        """Let the live character go on from a state of a take, on the take's ground."""
        controller = self.state.controller
        if controller is None:
            return
        if ground is not None and ground.terrain is not self.state.terrain:
            self.show_ground(ground.name, ground.terrain)
        snapshot.restore(controller)  # type: ignore[arg-type]
        self.state.simulation.go_on_from(pose)
        self.drives.forget()

    def _stop_loading(self) -> None:
        self.state.loading = ""

    def _open_gltf(self, path: Path) -> None:
        """A mesh with a skin is a character, one without is a ground."""

        def load(skinned: bool) -> None:
            (self.load_character if skinned else self._load_ground)(path)

        self.jobs.submit(Slot("open", path), lambda: has_skin(path), load, reading=path.name)

    def load_character(self, path: Path | None, joint_map: Path | None = None) -> None:
        """Show another skinned character; None is the shipped one. `joint_map` replaces the one beside it."""
        self.jobs.submit(
            Slot("character"),
            lambda: self.services.load_character(path, joint_map),
            lambda character: self._take_character(path, character),
            lambda error: self._refuse_character(path, error),
            reading=path.name if path else "",
        )

    def shape_mannequin(self, shape: BodyShape) -> None:
        """Show the mannequin in a shape: a file as any own character, which exports and projects take along."""
        self.state.shape = shape
        if shape == BodyShape():
            self.load_character(None)
        else:
            self.jobs.submit(Slot("shape"), partial(shaped_file, shape, self.cache), self._take_shape)

    def _take_shape(self, path: Path) -> None:
        self._shape_file = path
        self.load_character(path)

    @property
    def is_mannequin(self) -> bool:
        """Whether the character is the mannequin, in any shape."""
        return self.character_path is None or self.character_path == self._shape_file

    def _refuse_character(self, path: Path | None, error: Exception) -> None:
        """Let the joints be chosen by hand where they could not be guessed."""
        self.joints.refused(error)
        if path is not None and isinstance(error, JointsUnknown) and self.joints.shown != path:
            self.joints.begin(path)

    def _take_character(self, path: Path | None, character: Any) -> None:
        self.renderer.set_character(character)
        self._character, self.character_path = character, path
        if path is not None and not self.is_mannequin:
            self.messages.note(f"Character {path.name} loaded.")
        if self.joints.state.path == path:
            self.joints.close()

    def load_model(
        self,
        directory: Path | None,
        seed: int,
        gpt: GptSettings | None,
        done: Callable[[Loaded], None],
        failed: Callable[[], None],
    ) -> None:
        """Load the networks, whose prompts `gpt` answers; the character stands until they are there."""

        def take(loaded: Loaded) -> None:
            self.use_model(loaded)
            done(loaded)

        def fail(_: Exception) -> None:
            self.state.model_folder = before
            failed()

        terrain, before = self.state.terrain, self.state.model_folder
        self.state.model_folder = directory
        self.jobs.submit(
            Slot("model"), lambda: self.services.load_model(directory, terrain, seed, gpt), take, fail
        )

    def use_model(self, loaded: Loaded) -> None:
        """Let another model move the character."""
        loaded.controller.set_terrain(self.state.terrain)  # it may have changed while the model was loading
        first = self.state.controller is None
        self.state.simulation.use(loaded.controller)
        if first:
            self.reset_character()
        self.drives.forget()
        self.state.model_name, self.state.provider = loaded.name, loaded.provider
        if loaded.notice:
            self.messages.note(loaded.notice)

    def set_quality(self, name: str) -> None:
        """Render with another preset, "" for the one that fits this machine."""
        self._render_with(name)
        self.settings.quality = name

    def lower_quality(self, fps: float, dt: float) -> None:
        """Go to the fast preset where nobody chose one and the processor shows too few frames a second for some time."""
        slow = not self.settings.quality and self.state.quality == "software" and 0.0 < fps < SLOW_FPS
        self._slow_s = self._slow_s + dt if slow else 0.0
        if self._slow_s > SLOW_SECONDS:
            self._render_with("fast")
            self.messages.note(
                "This machine draws slowly: quality is “Fast” now. The Scene panel has the others."
            )

    def _render_with(self, name: str) -> None:
        renderer = self.services.make_renderer(self.ctx, name)
        renderer.set_terrain(self.state.terrain)
        if self._character is not None:
            renderer.set_character(self._character)
        self.renderer.release()
        self.renderer = renderer
        self.state.quality = renderer.quality.name


def has_skin(path: Path) -> bool:
    """Whether a glTF file holds a skin; FileError when it cannot be read."""
    from runtime.character.read import open_gltf

    return bool(open_gltf(path).gltf.skins)
