"""Pictures and the window."""

import numpy as np
import pytest

from spring_leg import Plant, picture
from spring_leg.hopper import HopperEnv

RGB = (picture.HEIGHT, picture.WIDTH, 3)


def has(image, colour):
    return (image == colour).all(axis=2)


def test_draws_body_leg_and_ground_where_they_are():
    image = picture.draw((5.0, 2.0), (5.0, 1.0), 0.0, 1.0)
    assert image.shape == RGB and image.dtype == np.uint8
    body, leg = has(image, picture.BODY), has(image, picture.LEG)
    rows, columns = np.nonzero(body)
    assert columns.mean() == pytest.approx(picture.WIDTH / 2, abs=1)
    scale = picture.HEIGHT / (picture.BELOW_M + picture.ABOVE_M)
    assert rows.mean() == pytest.approx(picture.HEIGHT - scale * (2 + picture.BELOW_M), abs=1)
    assert np.nonzero(leg)[0].max() == pytest.approx(
        picture.HEIGHT - scale * (1 + picture.BELOW_M), abs=4
    )
    assert has(image, picture.WATER).any() and not has(image, picture.AIR).any()
    ground = has(image, picture.GROUND) | has(image, picture.STRIPE)
    assert ground[-10:].all() and not ground[: picture.HEIGHT // 2].any()


def test_draws_what_is_out_of_the_picture():
    far = picture.draw((0.0, 900.0), (1e6, -5.0), 0.0, 0.0, [(1e9, 1.0)])
    assert far.shape == RGB and has(far, picture.BODY).any()


@pytest.mark.parametrize("preset", ["robust", "field"])
def test_a_step_follows_the_way_of_its_hop(preset):
    env = HopperEnv(preset, render_mode="rgb_array")
    env.reset(seed=5)
    first = env.render()
    assert first.shape == RGB
    while True:
        _, _, terminated, truncated, _ = env.step([0.05, -0.5])
        if terminated or truncated:
            break
        _, y_m, _ = env._hoppers.apex(0)
        heights = np.array(env._scene.trail)[:, 1]
        # The last point lies up to 20 ms after the apex.
        assert heights[-1] == pytest.approx(y_m, abs=0.01)
        assert not np.array_equal(env.render(), first)


def test_the_way_is_that_of_the_plant():
    env = HopperEnv("water", render_mode="rgb_array")
    compared = 0
    for seed in range(20):
        env.reset(seed=seed)
        vx_m_s, y_m, rho = env._hoppers.apex(0)
        action = np.array([0.1, -0.8], np.float32)
        plant = Plant(density_ratio=rho)
        course = plant.course([vx_m_s, y_m], env.physical_action(action))
        env.step(action)
        if course["fell"][0]:
            continue
        trail = np.array(env._scene.trail)
        assert trail[0] == pytest.approx([0, y_m])
        # The last point lies up to 20 ms after the apex.
        assert len(trail) - 1 == np.ceil(course["t_s"][0] / 0.02)
        assert trail[-1, 1] == pytest.approx(course["y_m"][0], abs=0.003)
        assert trail[-1, 0] == pytest.approx(course["x_m"][0], abs=0.02 * abs(vx_m_s) + 0.001)
        compared += 1
    assert compared > 5


def test_shows_each_hop_in_a_window(monkeypatch):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = HopperEnv("water", render_mode="human")
    env.metadata = {**env.metadata, "render_fps": 10_000}
    env.reset(seed=2)
    assert pygame.display.get_init() and env.render() is None
    env.step([0, -0.9])
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    assert np.array_equal(shown, env._scene.drawn())
    env.close()
    assert not pygame.display.get_init()
    env.close()
