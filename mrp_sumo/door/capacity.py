"""The number of robots that fit: the study of `mrp-sumo capacity`, with its results as frames."""

import html
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.core.children import num_workers
from mrp_sumo.door.scenario import Scenario
from mrp_sumo.io.scenario.file import find_scenario
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.io.summary import Summary, summary
from mrp_sumo.sizing.answer import Answer
from mrp_sumo.sizing.question import AS_MANY_AS_FIT, Question, effort_of
from mrp_sumo.sizing.reasons import PARTS, cycle
from mrp_sumo.sizing.study import Study

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, eq=False, repr=False)
class Capacity:
    """The answer of a study."""

    study: Answer
    page: Path  # one HTML file for any browser

    @property
    def answer(self) -> dict[str, Any]:
        """As `mrp-sumo capacity --json` prints it."""
        return dict(self.study.document["answer"])

    @property
    def sentence(self) -> str:
        """The answer in words."""
        return self.study.sentence

    @property
    def curve(self) -> "pandas.DataFrame":
        """A row for each number of robots: throughput_per_h with its limits low and high, and replications."""
        return _frame(self.answer["curve"])

    @property
    def parts(self) -> "pandas.DataFrame":
        """A row for each number of robots: mean parts of an order's time, in s."""
        return _frame([{"robots": point.robots, **{f"{part}_s": cycle(point)[part] for part in PARTS}} for point in self.study.points])

    @property
    def places(self) -> "pandas.DataFrame":
        """A row for each number of robots and station or place: kind, name, utilisation, waited_s_per_h; the heaviest first."""
        rows = [{"robots": of.robots, **vars(share)} for of in self.study.reasons for share in (*of.stations, *of.places)]
        return _frame(rows, "robots", "kind", "name", "utilisation", "waited_s_per_h")

    @property
    def what_if(self) -> "pandas.DataFrame":
        """A row for each change that was tried, the best first."""
        return _frame(self.answer["what_if"])

    @property
    def error_bands(self) -> dict[str, Any] | None:
        """Moves of the answer when quantities move within their intervals: sentence, robots, throughput_per_h, quantities."""
        return self.answer.get("error_bands")

    @property
    def _summary(self) -> Summary:
        rows: list[tuple[str, object]] = [("answer", self.sentence), *(("note", note) for note in self.study.notes), ("page", self.page)]
        return summary(f"Capacity of {self.answer['scenario']}", rows)

    def __repr__(self) -> str:
        return f"<Capacity of {self.answer['scenario']}: {self.sentence}>"

    def __str__(self) -> str:
        return self._summary.text

    def _repr_html_(self) -> str:
        page = html.escape(self.page.read_text(encoding="utf-8"))
        return f'<iframe srcdoc="{page}" style="width: 100%; height: 640px; border: 0"></iframe>'


def _frame(rows: list[dict[str, Any]], *columns: str) -> "pandas.DataFrame":
    import pandas as pd

    return pd.DataFrame(rows, columns=list(columns) or None)


def capacity(
    scenario: Scenario | str | Path,
    out: str | Path | None = None,
    *,
    robots: tuple[int, int] | None = None,
    demand_per_h: float | None = None,
    on_time: float | None = None,
    quick: bool = False,
    budget_s: float | None = None,
    horizon_s: float | None = None,
    what_if: Sequence[str] = (),
    engine: str = "kinematic",
    confirm: str | None = None,
    error_bands: bool | Mapping[str, tuple[float, float]] = False,
    seed: int | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Capacity:
    """Find out how many robots fit, and what binds.

    Parameters
    ----------
    scenario
        A scenario, its file, or the name of a bundled one such as "warehouse_lifelong".
    out
        Folder of runs and page; `runs/capacity_<scenario>` by default. Called again with the same folder, the study goes on where it was.
    robots
        The least and the most; from 4 to what the map holds by default, at most 200.
    demand_per_h, on_time
        Orders an hour that are to be served, by default the scenario's at its busiest, and the share that is to be on time, 0.95.
    quick
        Three seeds of 20 simulated minutes at first, and wider limits.
    budget_s
        What the study may take on two cores, as predicted.
    horizon_s
        Simulated time of a run.
    what_if
        Changes that are tried: "stations.pack: +1", "planner: lacam", "auto", ...
    engine
        "kinematic" or "sumo".
    confirm
        "sumo": drive the sizes that the answer names in SUMO, too; takes time on top of the budget.
    error_bands
        True: how much the answer moves when speed, acceleration, stops and times at stations move within their intervals, 10 % up and
        down where none is known. Or intervals of numbers of the scenario, such as {"robots.type.max_speed_mps": (0.9, 1.1)}.
    seed
        The first; the scenario's by default.
    workers
        Processes; one per core by default.
    progress
        Called with the number of runs that are done and of those that are known to be needed so far.

    Returns
    -------
    Capacity
        With `sentence`, `answer`, `curve`, `places`, `parts`, `what_if` and `page`.

    Raises
    ------
    MrpSumoError
        For what the scenario cannot answer, and for a folder that holds something else.

    Examples
    --------
    >>> study = ms.capacity("warehouse_lifelong", quick=True)
    >>> study.curve.plot("robots", "throughput_per_h")
    """
    from mrp_sumo.door.batches import Watching
    from mrp_sumo.experiments.batch import Making
    from mrp_sumo.reports.capacity.page import write_capacity_page

    file = scenario.file if isinstance(scenario, Scenario) else read_scenario(find_scenario(str(scenario)))
    workers = num_workers("workers", workers)
    study = Study(
        Question(
            file,
            sizes=robots or AS_MANY_AS_FIT,
            effort=effort_of(quick, budget_s, horizon_s),
            demand_per_h=demand_per_h or None,
            share=on_time or 0.0,
            engine=engine,
            first_seed=file.scenario.seed if seed is None else seed,
            what_if=tuple(what_if),
            confirm=confirm == "sumo",
            bounds=None if error_bands is False else () if error_bands is True else tuple(error_bands.items()),
            command=f"ms.capacity({file.scenario.name!r}, ...)",
        )
    )
    folder = Path("runs") / study.variations.suite.name if out is None else Path(out)
    answer = study.run(folder, Watching(progress), Making(workers))
    assert answer is not None  # nobody can stop it but by an exception
    return Capacity(answer, write_capacity_page(study, answer, folder))
