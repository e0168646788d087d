# SPDX-License-Identifier: Apache-2.0
import numpy as np

from viewer.grain import CYCLES, SIDE, SPREAD, noise_tile


def test_noise_has_the_spread_that_the_shaders_count_on() -> None:
    noise = noise_tile() / 255.0
    assert np.allclose(noise.mean((0, 1)), 0.5, atol=0.01)
    assert np.allclose(noise.std((0, 1)), SPREAD, rtol=0.03)
    assert abs(np.corrcoef(noise[..., 0].ravel(), noise[..., 1].ravel())[0, 1]) < 0.1


def test_noise_repeats_without_a_seam_and_prefers_no_direction() -> None:
    noise = noise_tile()[..., 0].astype(float)
    inner = np.abs(np.diff(noise, axis=0)).mean(), np.abs(np.diff(noise, axis=1)).mean()
    seam = np.abs(noise[0] - noise[-1]).mean(), np.abs(noise[:, 0] - noise[:, -1]).mean()
    assert np.allclose(seam, inner, rtol=0.25)
    assert abs(inner[0] / inner[1] - 1) < 0.05


def test_no_wave_is_shorter_than_four_texels() -> None:
    power = np.abs(np.fft.fft2(noise_tile()[..., 0] / 255.0 - 0.5)) ** 2
    cycles = np.hypot(*np.meshgrid(*[np.fft.fftfreq(SIDE, 1 / SIDE)] * 2))
    assert power[cycles > CYCLES[1] + 1].sum() < 0.005 * power.sum()
