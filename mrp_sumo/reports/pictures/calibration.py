"""A picture of a calibration: what was fitted, over what the log has."""

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from mrp_sumo.calibration.cruise import MEAN_LOSS, integrated_cov
from mrp_sumo.calibration.estimates import Calibration, Fits
from mrp_sumo.calibration.ramps import Ramp, position
from mrp_sumo.reports.pictures.map_picture import BLUE, INK, MUTED, PAPER, VERMILION
from mrp_sumo.reports.pictures.picture import Picture

SIZE_IN = (11.0, 6.6)
MOST = 250  # episodes that are drawn


def picture_of(result: Calibration) -> Picture:
    """Six panels: starts, stops, turns, speeds, their scatter over time, stops on the way."""
    figure = Picture(*SIZE_IN, PAPER)
    axes = figure.subplots(2, 3)
    fits = result.fits
    assert fits is not None
    title = f"{result.log.source}: {len(result.vehicles)} vehicles, {result.span_s / 3600:.1f} h in all"
    figure.suptitle(title, x=0.01, ha="left", fontsize=10, color=INK, parse_math=False)
    _ramp(axes[0, 0], fits.speeding, result, "accel_mps2", ("Speeding up", "after"))
    _ramp(axes[0, 1], fits.braking, result, "decel_mps2", ("Braking", "before"))
    _turns(axes[0, 2], fits, result)
    _speeds(axes[1, 0], fits, result)
    _scatter(axes[1, 1], fits, result)
    _stops(axes[1, 2], fits, result)
    for ax in axes.flat:
        ax.tick_params(labelsize=8, colors=MUTED)
        ax.locator_params(axis="x", nbins=5)
        ax.spines[["top", "right"]].set_visible(False)
        if not ax.has_data():
            ax.set_axis_off()
    figure.tight_layout(rect=(0, 0, 1, 0.97))
    return figure


def _told(ax: Axes, result: Calibration, name: str, title: str) -> bool:
    known = result.quantities.get(name)
    said = "not told" if known is None else f"{known.value:.3g} ({known.low:.3g} to {known.high:.3g}) {known.symbol}"
    ax.set_title(f"{title}: {said}", fontsize=8.5, loc="left", color=INK)
    return known is not None


def _ramp(ax: Axes, ramp: Ramp | None, result: Calibration, name: str, words: tuple[str, str]) -> None:
    title, when = words
    ax.set_xlabel(f"s {when} the stand", fontsize=8)
    ax.set_ylabel("m from the stand", fontsize=8)
    if not _told(ax, result, name, title) or ramp is None:
        return
    episodes = ramp.episodes
    picked = np.flatnonzero(ramp.used)[:: max(1, ramp.count // MOST)]
    after = (episodes.t_s - ramp.t0_s[:, None])[picked]
    along = (episodes.along_m - ramp.at_m[:, None])[picked]
    there = episodes.there[picked]
    ax.plot(after[there], along[there], ".", ms=2, color=BLUE, alpha=0.5, label="log")
    t = np.linspace(-2.0, float(np.quantile(after[there], 0.98)), 200)
    speed = float(np.median(ramp.fitted_mps[ramp.used]))
    ax.plot(t, position(t, np.full(len(t), speed), ramp.value), color=VERMILION, lw=1.4, label="fit, at the usual speed")
    ax.set_xlim(t[0], t[-1])
    ax.legend(fontsize=7.5, frameon=False)


def _turns(ax: Axes, fits: Fits, result: Calibration) -> None:
    ax.set_xlabel("angle turned by, rad", fontsize=8)
    ax.set_ylabel("s within the turn", fontsize=8)
    if not _told(ax, result, "turn_rate_rad_s", "Turning in place") or fits.turning is None:
        return
    turning = fits.turning
    inner = np.array(
        [np.count_nonzero((turned > 0.1) & (turned < whole - 0.1)) for turned, whole in zip(turning.turned_rad, turning.angle_rad)]
    )
    period = np.array([np.median(np.diff(t)) for t in turning.time_s])
    edges = np.quantile(turning.angle_rad, np.linspace(0, 1, 7))
    for low, high in pairwise(edges):
        mine = (turning.angle_rad >= low) & (turning.angle_rad <= high)
        if mine.any():
            ax.plot(turning.angle_rad[mine].mean(), (inner * period)[mine].mean(), "o", ms=4, color=BLUE)
    angle = np.linspace(0.4, 3.3, 50)
    ax.plot(angle, (angle - 0.2) / turning.value, color=VERMILION, lw=1.4)


def _speeds(ax: Axes, fits: Fits, result: Calibration) -> None:
    ax.set_xlabel("m/s between samples at top speed", fontsize=8)
    ax.set_ylabel("density", fontsize=8)
    if not _told(ax, result, "max_speed_mps", "Top speed") or fits.cruise is None:
        return
    windows = fits.cruise.windows
    there = np.arange(windows.dt_s.shape[1]) < windows.count[:, None]
    speed = (windows.step_m / windows.dt_s)[there]
    top, least = result.quantities["max_speed_mps"].value, 0.01 * float(speed.mean())  # speeds of exact logs are all the same
    ends = float(speed.min()) - least, float(speed.max()) + least
    ax.hist(speed, 50, range=ends, density=True, color=BLUE, alpha=0.6)
    ax.axvline(top, color=VERMILION, lw=1.4, label="top speed")
    for k, mean in enumerate(fits.cruise.mean_mps[np.isfinite(fits.cruise.mean_mps)]):
        ax.axvline(mean, color=MUTED, lw=0.7, ls=":", label="" if k else "means of vehicles")
    ax.legend(fontsize=7.5, frameon=False, loc="upper left")


def _scatter(ax: Axes, fits: Fits, result: Calibration) -> None:
    """Variance of the way driven in a time, about that at the mean speed."""
    ax.set_xlabel("s", fontsize=8)
    ax.set_ylabel("deviation of the way in that time, m", fontsize=8)
    if not _told(ax, result, "speed_noise", "Scatter of speed") or fits.cruise is None:
        return
    cruise, windows = fits.cruise, fits.cruise.windows
    x = np.concatenate((np.zeros((len(windows.count), 1)), np.cumsum(windows.dt_s, 1)), 1)
    s = np.concatenate((np.zeros((len(windows.count), 1)), np.cumsum(windows.step_m, 1)), 1)
    off = s - x * cruise.mean_mps[windows.vehicle][:, None]
    for lag in range(1, x.shape[1]):
        there = np.arange(x.shape[1] - lag) + lag <= windows.count[:, None]
        if there.sum() > 20:
            ax.plot(
                float((x[:, lag:] - x[:, :-lag])[there].mean()), float((off[:, lag:] - off[:, :-lag])[there].std()), "o", ms=4, color=BLUE
            )
    t = np.linspace(0.1, float(x.max(1).mean() * 1.3), 60)
    top = float(np.nanmedian(cruise.mean_mps)) / (1 - MEAN_LOSS * min(cruise.scatter.noise, 0.8))
    variance = np.array([integrated_cov(np.array([each]), cruise.scatter)[0, 0] for each in t]) * top**2 + 2 * cruise.noise_m**2
    ax.plot(t, np.sqrt(variance), color=VERMILION, lw=1.4)


def _stops(ax: Axes, fits: Fits, result: Calibration) -> None:
    ax.set_xlabel("s for which a vehicle is held", fontsize=8)
    ax.set_ylabel("stops on the way", fontsize=8)
    if not _told(ax, result, "stops_per_s", "Stops") or fits.stops is None or not len(fits.stops.hold_s):
        return
    ax.hist(fits.stops.hold_s, 20, color=BLUE, alpha=0.6)
    if fits.stops.median_s is not None:
        ax.axvline(fits.stops.median_s[0], color=VERMILION, lw=1.4)
