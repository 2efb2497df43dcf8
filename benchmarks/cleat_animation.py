"""The animation in docs/see_it.md: a belt over a cleat, by ``simulate`` with a road. Needs the extra ``plot``.

    python benchmarks/cleat_animation.py docs/see_it/cleat.gif

Drawn in the axle's frame, forward is right: the road comes from the right. Deflections and the cleat are drawn four
times as large.
"""

from __future__ import annotations

import math
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from tire_dynamics import TireWheelUnit, simulate
from tire_dynamics.science import road

SCALE = 4.0
LOAD = 4000.0  # [N]
SPEED = 20.0  # [rad/s], 22 km/h
STEP = 2.5e-4  # [s]
CLEAT = 0.01, 0.15, 0.02  # height, begin, length [m]
FRAMES = range(0, 280, 4)  # one each millisecond
PAUSE = 60  # [ms] between two
COLOURS = 24
INK, ROAD, AXLE = "#222222", "#c85000", "#0a50a0"

TIRE = TireWheelUnit.table_1(
    contact_half_angle=0.15, vertical_stiffness=2e5, sidewall_damping="reaction", zeta_s=0.3, sprung_mass=350.0
)


def main(path: str) -> None:
    """Write the animation."""
    profile = road.bump(*CLEAT)
    time = STEP * np.arange(321)
    way = SPEED * TIRE.radius * time
    psi = np.linspace(0.0, 2.0 * math.pi, 361)
    under_the_wheel = profile.averaged(2.0 * TIRE.radius * math.sin(TIRE.contact_half_angle / 9)).at(way)
    drive = simulate(TIRE, time, SPEED, psi=psi, road=under_the_wheel, static_load=LOAD, contact_points=9)
    assert drive.u_z is not None and drive.u_theta is not None

    figure, (picture, plot) = plt.subplots(
        1, 2, figsize=(7.2, 3.1), width_ratios=(1.0, 1.35), dpi=90, layout="constrained"
    )
    picture.set(aspect="equal", xlim=(-0.42, 0.42), ylim=(-0.42, 0.36))
    picture.axis("off")
    picture.plot(0.0, 0.0, "+", color=INK, markersize=10)
    (belt,) = picture.plot([], [], color=INK, linewidth=2.0)
    (surface,) = picture.plot([], [], color=ROAD, linewidth=2.0)
    ahead = np.linspace(-0.42, 0.42, 1500)

    plot.plot(1e3 * time, drive.contact_force, color=ROAD, label="road on the tire")
    plot.plot(1e3 * time, drive.axle_force[:, 1], color=AXLE, label="wheel on the axle")
    dots = plot.scatter([0.0, 0.0], [LOAD, LOAD], color=[ROAD, AXLE], zorder=3)
    plot.set(xlabel="time [ms]", ylabel="vertical force [N]", xlim=(0.0, 70.0))
    plot.grid(color="#e0e0e0")
    plot.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    for side in ("top", "right"):
        plot.spines[side].set_visible(False)

    def shape(k: int) -> tuple[np.ndarray, np.ndarray]:
        outward, along = TIRE.radius + SCALE * drive.u_z[k], SCALE * drive.u_theta[k]
        return -outward * np.cos(psi) + along * np.sin(psi), outward * np.sin(psi) + along * np.cos(psi)

    ground = shape(0)[1].min()  # the tread has no thickness in the model: the belt is drawn on the road at the start

    def draw(k: int) -> Image.Image:
        belt.set_data(*shape(k))
        rise = drive.wheel_displacement[k] - drive.wheel_displacement[0]
        surface.set_data(ahead, ground + SCALE * (profile.at(way[k] + ahead) - rise))
        dots.set_offsets([[1e3 * time[k], drive.contact_force[k]], [1e3 * time[k], drive.axle_force[k, 1]]])
        figure.canvas.draw()
        return Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3]).quantize(COLOURS)

    first, *others = map(draw, FRAMES)
    first.save(path, save_all=True, append_images=others, duration=PAUSE, loop=0, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1])
