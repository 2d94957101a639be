"""Scripted paths and clip generation, with a synthetic walker in place of the network."""

import numpy as np
import pytest

import runtime.generate as generate_module
from runtime.controls import Gait
from runtime.errors import PromptError, SportError, TerrainError, UsageError
from runtime.generate import DEFAULT_PROMPT, generate_clip, parse_prompts, simulate
from runtime.motion.control_scripts import GAITS, PATH_NAMES, PlanarPose, control_script
from runtime.motion.controller import Controller
from runtime.prompts.parts import PartDescriptions
from runtime.takes.metadata import PromptEvent
from runtime.terrain.height_map import Terrain
from tests.helpers.walker import WALK_SPEED, OtherStyles, WalkerModel


def follow(script, seconds, speed=1.4):
    """A point that obeys the stick with some inertia; its path `(T, 2)`."""
    at, velocity, yaw, path = np.zeros(2), np.zeros(2), 0.0, []
    for frame in range(round(seconds * 60)):
        controls = script(frame / 60, PlanarPose(at[0], at[1], yaw))
        assert np.hypot(*controls.move) <= 1.0 + 1e-9
        velocity += 0.1 * (speed * np.array(controls.move) - velocity)
        at = at + velocity / 60
        yaw = float(np.arctan2(*velocity)) if np.hypot(*velocity) > 0.1 else yaw
        path.append(at)
    return np.array(path)


def test_the_stick_of_a_clip_is_text(walker):
    clip = generate_clip("calm", controls="walk@90 1; jog 1")
    assert len(clip.hips_positions) == 120
    assert clip.hips_positions[-1, 0] > 0.5 * WALK_SPEED
    assert (set(clip.gaits[:60]), set(clip.gaits[60:])) == ({Gait.WALK}, {Gait.JOG})


def test_a_start_takes_the_time_of_a_body_and_that_of_a_game_at_full_response(walker):
    clips = [generate_clip("calm", controls="stand 0.2; walk 0.6", response=r) for r in (0.0, 0.5, 1.0)]
    way = [np.ptp(clip.hips_positions[:, 2]) for clip in clips]
    assert way[0] < way[1] < way[2]
    assert way[0] < 0.6 * way[2]


def test_forward_goes_along_z():
    path = follow(control_script("forward", "walk"), 10)
    assert path[-1, 1] > 12
    assert np.abs(path[:, 0]).max() < 0.05


def test_circle_keeps_its_radius_and_goes_round():
    path = follow(control_script("circle", "walk"), 30)
    assert np.abs(np.hypot(path[:, 0] - 3.0, path[:, 1]) - 3.0).max() < 0.4
    angle = np.unwrap(np.arctan2(path[:, 0] - 3.0, path[:, 1]))
    assert angle[-1] - angle[0] > 2 * np.pi  # towards +X, clockwise from above


def test_figure8_visits_both_lobes_in_turn():
    path = follow(control_script("figure8", "walk"), 60)
    sides = np.sign(path[np.abs(path[:, 0]) > 3.0, 0])
    assert np.sum(sides[1:] != sides[:-1]) >= 3
    assert np.abs(path[:, 0]).max() < 4.6
    assert np.abs(path[:, 1]).max() < 2.8


def test_random_stays_about_the_middle_and_depends_on_the_seed():
    first, second = (follow(control_script("random", "walk", seed=seed), 120) for seed in (1, 2))
    assert np.hypot(*first.T).max() < 24
    assert np.abs(first - second).max() > 1.0
    np.testing.assert_array_equal(first, follow(control_script("random", "walk", seed=1), 120))


@pytest.mark.parametrize("path", PATH_NAMES)
@pytest.mark.parametrize("gait", GAITS)
def test_gait_and_speed_arrive_in_the_controls(path, gait):
    controls = control_script(path, gait, speed=0.5)(0.1, PlanarPose(0.0, 0.0, 0.0))
    assert np.hypot(*controls.move) == pytest.approx(0.0 if gait == "stand" else 0.5)
    assert controls.gait == (Gait.WALK if gait == "stand" else GAITS[gait])


@pytest.mark.parametrize(
    ("arguments", "field"),
    [(("spiral", "walk"), "path"), (("circle", "fly"), "gait"), (("circle", "walk", 1.5), "speed"),
     (("circle", "walk", 0.0), "speed"), (("circle", "walk", float("nan")), "speed")],
)  # fmt: skip
def test_unknown_paths_gaits_and_speeds_are_named(arguments, field):
    with pytest.raises(UsageError, match=field):
        control_script(*arguments)


def test_prompts_with_times_are_parsed_and_sorted():
    events = (PromptEvent(0.0, "walk calmly"), PromptEvent(4.0, "drunk"))
    assert parse_prompts("4: drunk ;0:walk calmly") == events
    assert parse_prompts("1.5:a: b") == (PromptEvent(1.5, "a: b"),)
    for bad in ("", "drunk", "0:", "-1:x", "0:a;;1:b"):
        with pytest.raises(PromptError, match="SECONDS:PROMPT"):
            parse_prompts(bad)


@pytest.mark.parametrize("terrain", ["hills", "stairs"])
def test_a_clip_has_the_asked_length_and_moves(walker, terrain):
    clip = generate_clip("a proud queen", terrain, "forward", "walk", seconds=2.5, name="queen")
    assert (clip.name, clip.fps, len(clip), clip.terrain) == ("queen", 60.0, 150, terrain)
    assert clip.prompts == (PromptEvent(0.0, "a proud queen"),)
    assert clip.hips_positions[-1, 2] - clip.hips_positions[0, 2] > 1.5 * WALK_SPEED
    assert np.isfinite(clip.world()[0]).all()


def test_equal_arguments_give_equal_bytes_and_seeds_and_prompts_differ(walker):
    def make(prompt="calm", seed=0):
        clip = generate_clip(prompt, "flat", "random", "walk", seconds=0.5, seed=seed)
        return clip.hips_positions.tobytes() + clip.local_rotations.tobytes()

    assert make() == make()
    assert make() != make(seed=1)
    assert make() != make(prompt="drunk")


def test_a_later_prompt_blends_in_at_its_time(walker):
    one = generate_clip("calm", path="forward", seconds=2.0)
    events = parse_prompts("0:calm; 0.5:drunk")
    two = generate_clip(events, path="forward", seconds=2.0, transition_seconds=1.0)
    different = np.abs(one.local_rotations - two.local_rotations).max(axis=(1, 2))
    assert different[:30].max() == 0.0
    assert 0.0 < different[45] < different[115]


def test_before_the_first_prompt_somebody_walks_by_the_default_one(walker):
    clip = generate_clip(parse_prompts("0.2:drunk"), path="forward", seconds=0.4)
    told = [(event.seconds, event.prompt) for event in clip.prompts]
    assert told == [(0.0, DEFAULT_PROMPT), (0.2, "drunk")]


def test_a_clip_tells_what_it_was_made_with(walker, monkeypatch):
    parts = PartDescriptions(*("arm", "arm", "leg", "leg", "torso", "head"))

    def prompter(model, expander, report, text_encoder, expanded):
        class Told(OtherStyles):
            def style(self, prompt, exact_legs):
                expanded(prompt, parts)
                return super().style(prompt, exact_legs)

        return Told()

    monkeypatch.setattr(generate_module, "Prompter", prompter)
    prompts = parse_prompts("0:calm; 0.2:drunk")
    clip = generate_clip(prompts, "hills", gait="jog", seconds=0.5, seed=5, transition_seconds=0.5)
    said = parts.to_json()
    assert clip.prompts == (PromptEvent(0.0, "calm", 0.0, said), PromptEvent(0.2, "drunk", 0.5, said))
    assert (clip.origin.seed, clip.origin.strength, clip.origin.terrain_seed) == (5, 1.0, 0)
    assert dict(clip.gait_seconds) == {"jog": 0.5}


@pytest.mark.parametrize(
    ("changes", "error", "expected"),
    [({"prompt": "  "}, PromptError, "prompt"), ({"prompt": "x" * 10_000}, PromptError, "prompt"),
     ({"terrain": "lava"}, TerrainError, "lava"), ({"seconds": 0.0}, UsageError, "seconds"),
     ({"seconds": 1e9}, UsageError, "seconds"), ({"transition_seconds": -1.0}, UsageError, "transition_seconds"),
     ({"strength": 2.5}, UsageError, "strength"), ({"strength": float("nan")}, UsageError, "strength"),
     ({"response": 1.5}, UsageError, "response"), ({"response": float("nan")}, UsageError, "response")],
)  # fmt: skip
def test_what_cannot_be_used_is_named(walker, changes, error, expected):
    with pytest.raises(error, match=expected):
        generate_clip(**changes)


def test_a_network_that_fails_gives_an_error_not_a_clip():
    controller = Controller(WalkerModel(broken_at=5), Terrain.flat())
    with pytest.raises(SportError, match="frame 4"):
        simulate(controller, control_script("forward", "walk"), [], 20)
