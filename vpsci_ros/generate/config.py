"""Parameters of stage 3 as a dataset."""

from dataclasses import dataclass

from vpsci_ros.parameters import parameter


@dataclass(frozen=True)
class DatasetConfig:
    """Content of a dataset."""

    kept: int = parameter(
        0, "kept episodes wanted in each scenario; 0: the counts of Table 10", low=0, high=1_000_000_000
    )
    formats: list[str] = parameter(["parquet"], "files to write for each scenario", choices=("parquet", "csv"))
    keep_rejected: bool = parameter(False, "write rejected episodes to the folder rejected/")
