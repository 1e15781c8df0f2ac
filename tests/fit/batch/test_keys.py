"""The storage key of a fit changes with everything that changes the fit, and with nothing else."""

from __future__ import annotations

import subprocess
import sys
from importlib import metadata

import pytest

from fit.batch.jobs import key_of
from fit.identification.request import Plan
from fit.provenance import physics_version

PLAN = Plan(method="kinect-skirt", iterations=8, spacing=0.1)


def test_the_key_changes_with_the_take_every_option_and_the_physics_and_with_nothing_else():
    other = {
        "method": "kinect-skirt-weighed", "effects": ("air_drag",), "bounds": ("bend=1:2",), "iterations": 9,
        "gamma": 1.0, "spacing": 0.05, "seed": 1, "search": "cma-es", "fabric": "silk",
    }  # fmt: skip
    plain = key_of("take", PLAN, "physics")
    keys = [
        key_of("take", Plan(**{"method": "kinect-skirt", "iterations": 8, "spacing": 0.1, k: v}), "physics")
        for k, v in other.items()
    ]
    keys += [key_of("another", PLAN, "physics"), key_of("take", PLAN, "other")]
    assert len({plain, *keys}) == len(other) + 3
    assert (
        key_of("take", Plan(spacing=0.1, method="kinect-skirt", iterations=8, search="annealing"), "physics") == plain
    )


def test_the_physics_is_the_source_of_every_module_that_a_fit_loads():
    code = """
        import sys
        from pathlib import Path
        import tests.fit.conftest
        import fit
        from fit.identification.calibrate import calibrate
        from fit.cloth import rollout
        from fit.observer import residuals
        from fit.search import cma_es, tempering
        from formats import archive
        from fit.provenance import has_part
        top = Path(fit.__file__).parent.parent
        used = [Path(m.__file__).relative_to(top).as_posix() for n, m in sys.modules.items()
                if n.startswith(("fit.", "formats.")) and not n.startswith("fit.batch")]
        assert len(used) > 30
        assert "formats/archive.py" in used
        print([path for path in used if not has_part(path)])
    """
    code = "\n".join(line[8:] for line in code.splitlines())
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("library", ["cmaes", "numpy", "scipy", "taichi"])
def test_the_physics_changes_with_the_version_of_each_library(monkeypatch, library):
    installed = metadata.version
    before = physics_version.__wrapped__()
    monkeypatch.setattr(metadata, "version", lambda name: "0.0" if name == library else installed(name))
    assert physics_version.__wrapped__() != before
