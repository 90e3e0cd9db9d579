"""Studies of learning as commands: Tables 3 and 9 beside the paper's values."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from vpsci_ros.cli.stages import Stage1Inputs, stage_1_inputs, stage_2_parameters
from vpsci_ros.data.corpus import corpus_files
from vpsci_ros.data.near_misses import read_near_misses
from vpsci_ros.documents import listed
from vpsci_ros.errors import InvalidInput
from vpsci_ros.extras.paper.models import ROWS
from vpsci_ros.extras.paper.studies.learning import SAMPLE_SIZES, sample_size_study
from vpsci_ros.extras.paper.studies.model_comparison import RESULT as MODELS_RESULT
from vpsci_ros.extras.paper.studies.model_comparison import compare_models
from vpsci_ros.extras.paper.studies.model_table import Hybrid
from vpsci_ros.extras.paper.studies.state import StudyReport
from vpsci_ros.extras.paper.studies.table_9_page import PAGE, table_9_page
from vpsci_ros.extras.paper.studies.tables import print_table_3
from vpsci_ros.policy.models import MODELS
from vpsci_ros.runs.files import write_text
from vpsci_ros.runs.progress import StageBar
from vpsci_ros.runs.run_config import Sections
from vpsci_ros.runs.run_folder import RunFolder
from vpsci_ros.runs.stop_request import stop_requested_by_signals
from vpsci_ros.runs.text_table import table_console
from vpsci_ros.runs.workers import HERE, Site, mixed

FRESH_SEED = 1000  # of the episodes in which models are measured


def run_sample_study(
    sections: Sections, folder: Path, sizes: Sequence[int], *, site: Site = HERE, quiet: bool = False
) -> None:
    """Run `sample_size_study` (Table 3) in `folder`; resume a stopped study.

    :param sizes: interactions to learn from; none: the paper's.
    :raises InvalidInput: a parameter, a size or the near misses are refused, or `folder` holds another study.
    :raises Stopped: a signal stopped it; what is done is in `folder`.
    """
    sizes = sizes or SAMPLE_SIZES
    learner, config, network, corpus, resolved = _stage_1_inputs(sections)
    facts = {"study": {"sizes": list(sizes)}} | mixed(site)
    with RunFolder(folder, resolved, corpus_files(learner.near_misses), facts) as run:
        with _shown("samples", "{} interactions", quiet, site) as report:
            table = sample_size_study(
                corpus, config, network, sizes=sizes, seed=learner.seed, out_dir=folder, site=site, report=report
            )
        run.results["table_3"] = table.to_dicts()
    print_table_3(table, table_console())
    print(f"written: {folder / 'table_3.csv'} and run.json beside it")


def _stage_1_inputs(sections: Sections) -> Stage1Inputs:
    """Return the inputs of stage 1, see `stage_1_inputs`.

    :raises InvalidInput: also where they name clips to hold out, which no study would do.
    """
    inputs = stage_1_inputs(sections)
    if inputs[1].held_out_clips:
        raise InvalidInput(
            f"learner.held_out_clips = {listed(inputs[1].held_out_clips)}: a study chooses the clips that it holds out "
            "itself; leave it out"
        )
    return inputs


@contextlib.contextmanager
def _shown(study: str, title: str, quiet: bool, site: Site) -> Iterator[StudyReport]:
    """Show the progress of a study; yield its report function, which raises `Stopped` after a signal.

    Where other processes learn, the signal itself does: nobody waits for their next result.

    :param title: of the progress bar, with {} for the name of a part.
    """
    with StageBar(study, quiet) as bar, stop_requested_by_signals() as stop, contextlib.ExitStack() as others:
        if not site.alone:
            others.enter_context(stop.at_once())

        def report(name: str, values: dict[str, float]) -> None:
            bar.show(values, title.format(name))
            stop.check()

        yield report


def run_model_study(
    sections: Sections,
    folder: Path,
    models: Sequence[str],
    *,
    folds: int,
    refine: Sections | None,
    simulated: Path | None,
    fresh_episodes: int,
    site: Site = HERE,
    quiet: bool = False,
) -> None:
    """Run `compare_models` (Table 9) in `folder`; resume a stopped study.

    :param models: names of `vpsci_ros.policy.models.MODELS`; none: this package's.
    :param folds: trainings of each model.
    :param refine, simulated: sections of stage 2 for models by reinforcement, and a near-miss table of simulated
        interactions for the others; None: data-driven learning alone.
    :param fresh_episodes: in each scenario, by `FRESH_SEED`, in which every model is measured.
    :raises InvalidInput: a parameter, a model's name, the number of folds or the near misses are refused, one of
        `refine` and `simulated` is missing, or `folder` holds another study.
    :raises Stopped: a signal stopped it; what is done is in `folder`.
    """
    models = list(models) or list(ROWS)
    for name in models:
        MODELS.find(name)
    learner, config, network, corpus, resolved = _stage_1_inputs(sections)
    hybrid, files = _hybrid(refine, simulated, fresh_episodes), corpus_files(learner.near_misses)
    facts: dict[str, Any] = {"models": models, "folds": folds}
    if hybrid is not None:
        assert simulated is not None
        facts |= {"hybrid": hybrid.identity(), "fresh_episodes": fresh_episodes, "fresh_seed": hybrid.seed}
        files = [*files, simulated]
    with RunFolder(folder, resolved, files, {"study": facts} | mixed(site)) as run:
        with _shown("models", f"fold {{}} of {folds}", quiet, site) as report:
            result = compare_models(
                corpus,
                config,
                network,
                models=models,
                folds=folds,
                seed=learner.seed,
                out_dir=folder,
                hybrid=hybrid,
                site=site,
                report=report,
            )
        run.results |= result
        page = table_9_page(result)
        write_text(folder / PAGE, page)
    print(page)
    print(f"written: {folder / MODELS_RESULT}, {PAGE} and run.json beside it")


def _hybrid(refine: Sections | None, simulated: Path | None, fresh_episodes: int) -> Hybrid | None:
    if refine is None and simulated is None:
        return None
    if refine is None or simulated is None:
        raise InvalidInput("hybrid learning: expected both --refine FILE and --simulated FILE, or neither")
    _, config, simulation = stage_2_parameters(refine)
    episodes = [(scenario.number, number) for number in range(fresh_episodes) for scenario in simulation.scenarios]
    return Hybrid(config, simulation, read_near_misses(simulated), episodes, FRESH_SEED)
