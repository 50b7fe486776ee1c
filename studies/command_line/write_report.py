"""`readhesion report`: a comparison as one HTML file that opens offline."""

from pathlib import Path

from studies.command_line.options import (
    ALL_FAILED,
    MOST_SEEDS,
    FilePath,
    Names,
    Whole,
    check_whole,
    command_of,
    process_count,
    split_names,
)  # fmt: skip
from studies.command_line.terminal import console, counted, progress
from studies.files.writable import PAGE, check_file, check_place


def write_report(
    *,
    scenario: Names = None,
    rules: Names = None,
    controllers: Names = None,
    seeds: Whole | None = None,
    out: FilePath = Path("report.html"),
    results: FilePath = Path("results"),
    jobs: Whole | None = None,
) -> int:
    """Write a comparison into one HTML file: answer, table, gain against headroom, replays, provenance, sources.

    The file opens in a browser without network, and stays below 15 MB. Rows that the results
    folder already holds are not run again. The exit code is 1 if no run is ok.

    Parameters
    ----------
    scenario
        Names of shipped scenarios or paths of TOML files [default: those of `readhesion compare`].
    rules
        Allocation rules [default: those of `readhesion compare`].
    controllers
        Readhesion controllers [default: cut-and-ramp, perturb-observe, and mpc on the first seed].
    seeds
        Number of seeds [default: 5, but 1 where nothing is drawn]; replays show the first.
    out
        HTML file; one that is there is replaced.
    results
        Folder of a comparison; what it lacks is run and kept there.
    jobs
        Number of processes [default: one per core].
    """
    from alloc.sources import write_whole
    from studies.comparison.defaults import make_grid
    from studies.core.workers import workers
    from studies.report.gathering import gather
    from studies.report.page import check_packages, rendered
    from studies.scenario.loading import default_scenarios, load_scenario

    count = process_count(jobs)
    if seeds is not None:
        check_whole("--seeds", seeds, 1, MOST_SEEDS)
    check_file(out, PAGE)
    check_place(results, "results", "--results", of_results=True)
    names = split_names(scenario)
    chosen = default_scenarios() if names is None else [load_scenario(name) for name in dict.fromkeys(names)]  # fmt: skip
    grid = make_grid(chosen, split_names(rules), split_names(controllers), seeds)
    check_packages()
    parts = {
        "scenario": scenario,
        "rules": rules,
        "controllers": controllers,
        "seeds": None if seeds is None else [str(seeds)],
    }
    command = command_of("report", **parts)
    with workers(count) as others, progress() as on_row:
        material = gather(grid, results, command, others, on_row)
    page = rendered(material)
    write_whole(out, lambda path: path.write_text(page, encoding="utf-8"))
    size = len(page.encode()) / 1e6
    console().print(
        f"{counted(material.table, 'runs')}, {len(material.replays)} replays, {size:.1f} MB: {out}"
    )
    return 0 if (material.table["status"] == "ok").any() else ALL_FAILED
