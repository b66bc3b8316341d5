"""Suites of runs: made in parallel, resumed where they were, read as a DataFrame."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.core.children import num_workers
from mrp_sumo.errors import BatchError
from mrp_sumo.experiments.batch import BatchFolder, Making, Watcher, run_batch
from mrp_sumo.experiments.batch import summary as standing
from mrp_sumo.experiments.suite import find_suite, read_suite
from mrp_sumo.io.results import load_results
from mrp_sumo.io.summary import Summary, summary, with_summary
from mrp_sumo.plugins.trust import everything_trusted

if TYPE_CHECKING:
    import pandas


@with_summary
@dataclass(frozen=True, eq=False, repr=False)
class Batch:
    """The results of a suite's runs, and the folder that keeps them."""

    name: str  # of the suite
    folder: Path
    num_runs: int
    counts: dict[str, int]  # how many runs ended how
    standing: str  # in a line

    @cached_property
    def results(self) -> "pandas.DataFrame":
        """One row per run, in the order of the suite: status, parameters, metrics; see `load_results`."""
        return load_results(self.folder)

    def query(self, sql: str) -> "pandas.DataFrame":
        """The rows that SQL selects of the table `results`.

        Raises
        ------
        MrpSumoError
            When the query is refused.
        """
        from mrp_sumo.io.results import query

        return query(self.folder, sql)

    def report(self, out: str | Path | None = None) -> Path:
        """Write the page of tables and charts about the batch.

        Parameters
        ----------
        out
            Folder of the page; `report` in the batch's folder by default.

        Returns
        -------
        Path
            The page.
        """
        from mrp_sumo.reports.report import write_report

        return write_report(self.folder, None if out is None else Path(out))

    @property
    def _summary(self) -> Summary:
        rows: list[tuple[str, object]] = [("folder", self.folder), ("runs", self.standing)]
        rows += [(status.replace("_", " "), number) for status, number in sorted(self.counts.items())]
        return summary(f"Batch {self.name}", rows)

    def __repr__(self) -> str:
        return f"<Batch {self.name}: {self.standing}, in {self.folder}>"


def run_suite(
    suite: str | Path,
    out: str | Path | None = None,
    *,
    workers: int | None = None,
    retries: int = 1,
    progress: Callable[[int, int], None] | None = None,
    trust: bool = False,
) -> Batch:
    """Make the runs of a suite that have no result yet, in parallel.

    Parameters
    ----------
    suite
        A suite file, or the name of a bundled suite such as "paper_comparison".
    out
        Folder of the results; `runs/<suite>` by default. Called again with the same folder, it goes on where it was.
    workers
        Processes; one per core by default.
    retries
        How often a run that crashed is tried again.
    progress
        Called with the number of runs that are done and of all runs.
    trust
        Whether to run the programs that the suite names, as for `Scenario.read`.

    Returns
    -------
    Batch
        With `results` as a DataFrame.

    Raises
    ------
    MrpSumoError
        For faults of the suite, and for a folder that holds something else.

    Examples
    --------
    >>> batch = ms.run_suite("paper_comparison", workers=2)
    >>> batch.results.groupby("planner")["success"].mean()
    """
    workers = num_workers("workers", workers)
    if retries < 0:
        raise BatchError(f"retries: found {retries}, expected 0 or more")
    file = read_suite(find_suite(str(suite)))
    folder = Path("runs") / file.name if out is None else Path(out)
    with everything_trusted(trust):
        made: BatchFolder = run_batch(file, folder, Watching(progress), Making(workers, retries=retries))
    return Batch(file.name, folder, len(made.runs), dict(made.counts()), standing(made))


class Watching(Watcher):
    """Hands on how far a batch is, and warns of what a person should know."""

    def __init__(self, progress: Callable[[int, int], None] | None) -> None:
        self.progress = progress

    def report(self, line: str) -> None:
        warnings.warn(line, stacklevel=2)

    def show(self) -> None:
        if self.progress:
            self.progress(self.num_done, self.num_runs)
