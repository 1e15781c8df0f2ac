"""A batch starts no more workers than processors and memory allow, and refuses numbers without a meaning."""

from __future__ import annotations

import pytest

from fit.batch import room
from fit.batch.cluster import Workers
from fit.batch.room import NEEDED, Room, room_here
from tests.fit.batch.night import SHORT, make_takes
from tests.fit.here import hangtime_here


@pytest.mark.parametrize(
    ("asked", "jobs", "memory", "count", "why"),
    [
        (300, 400, 64e9, 8, "8 workers instead of 300: this machine has 8 processors for them, and each fit uses one."),
        (300, 3, 64e9, 3, ""),
        (2, 400, 64e9, 2, ""),
        (None, 400, 64e9, 8, ""),
        (None, 400, 2.2 * NEEDED, 2, "2 workers instead of 8: 1.1 GB of memory are free, and a worker needs 500.0 MB."),
        (5, 400, 1e6, 1, "1 worker instead of 5: 1.0 MB of memory are free, and a worker needs 500.0 MB."),
        (300, 400, None, 8, "8 workers instead of 300: this machine has 8 processors for them, and each fit uses one."),
    ],
)
def test_workers_are_as_many_as_jobs_processors_and_memory_allow_and_the_reason_is_named(
    asked, jobs, memory, count, why
):
    workers, told = Workers(count=asked).at_most(jobs, Room(processors=8, memory=memory))
    assert (workers.count, told) == (count, why)


def test_the_room_is_what_the_system_states_and_a_limit_of_a_container_counts(tmp_path, monkeypatch):
    (tmp_path / "meminfo").write_text("MemTotal: 99 kB\nMemAvailable:    3000000 kB\n")
    monkeypatch.setattr(room, "MEMORY", tmp_path / "meminfo")
    monkeypatch.setattr(room, "GROUPS", tmp_path)
    monkeypatch.setattr(room, "OWN_GROUP", tmp_path / "absent")
    assert room_here().memory == 3_072_000_000
    (tmp_path / "memory.max").write_text("max\n")
    assert room_here().memory == 3_072_000_000
    (tmp_path / "memory.max").write_text("2000000000\n")
    (tmp_path / "memory.current").write_text("1500000000\n")
    assert room_here().memory == 500_000_000
    (tmp_path / "meminfo").write_text("MemAvailable: unknown\n")
    (tmp_path / "memory.max").unlink()
    assert room_here().memory is None


@pytest.mark.parametrize(
    ("limited", "own"),
    [("", "0::/\n"), ("", "0::/elsewhere\n"), ("user.slice/batch.service", "1:cpu:/\n0::/user.slice/batch.service\n"),
     ("user.slice", "0::/user.slice/batch.service\n")],
)  # fmt: skip
def test_cached_pages_of_files_are_free_memory_and_a_services_own_limit_and_its_slices_count(
    tmp_path, monkeypatch, limited, own
):
    (tmp_path / "meminfo").write_text("MemAvailable:    9000000 kB\n")
    (tmp_path / "cgroup").write_text(own)
    group = tmp_path / "groups" / limited
    (tmp_path / "groups/user.slice/batch.service").mkdir(parents=True)
    (tmp_path / "groups/user.slice/batch.service/memory.max").write_text("max\n")
    (group / "memory.max").write_text("4000000000\n")
    (group / "memory.current").write_text("3900000000\n")
    (group / "memory.stat").write_text(
        "anon 600000000\nfile 3300000000\nactive_file 300000000\ninactive_file 2900000000\n"
    )
    monkeypatch.setattr(room, "MEMORY", tmp_path / "meminfo")
    monkeypatch.setattr(room, "GROUPS", tmp_path / "groups")
    monkeypatch.setattr(room, "OWN_GROUP", tmp_path / "cgroup")
    assert room_here().memory == 4_000_000_000 - 700_000_000  # 3.9 GB used, of which 3.2 GB are pages of files
    (group / "memory.stat").write_text("active_file many\n")
    assert room_here().memory == 100_000_000


@pytest.fixture
def limits(tmp_path, monkeypatch):
    """Write the files of control groups; 9.2 GB are free, and this process may use eight processors."""
    (tmp_path / "meminfo").write_text("MemAvailable:    9000000 kB\n")
    monkeypatch.setattr(room, "MEMORY", tmp_path / "meminfo")
    monkeypatch.setattr(room, "GROUPS", tmp_path / "groups")
    monkeypatch.setattr(room, "OWN_GROUP", tmp_path / "cgroup")
    monkeypatch.setattr("os.sched_getaffinity", lambda process: set(range(8)))

    def write(own, files):
        (tmp_path / "cgroup").write_bytes(own)
        for name, text in files.items():
            (tmp_path / "groups" / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / "groups" / name).write_text(text)

    return write


@pytest.mark.parametrize("group", ["memory", "memory/docker/7f"])
def test_the_memory_limit_of_version_1_counts(limits, group):
    """In a container its own group is the root of what it sees, whatever /proc calls it."""
    files = {"limit_in_bytes": "4000000000\n", "usage_in_bytes": "3900000000\n",
             "stat": "active_file 7\ntotal_active_file 300000000\ntotal_inactive_file 2900000000\n"}  # fmt: skip
    limits(b"9:name=systemd:/\n4:memory:/docker/7f\n", {f"{group}/memory.{name}": text for name, text in files.items()})
    assert room_here().memory == 4_000_000_000 - 700_000_000


def test_no_limit_of_version_1_is_none(limits):
    """It states the largest number of whole pages, 2^63 - 4096 (kernel, memcontrol.c)."""
    limits(b"4:memory:/\n", {"memory/memory.limit_in_bytes": "9223372036854771712\n",
                             "memory/memory.usage_in_bytes": "5\n"})  # fmt: skip
    assert room_here().memory == 9_216_000_000


@pytest.mark.parametrize(
    ("files", "processors"),
    [
        ({"a/cpu.max": "250000 100000\n"}, 2),
        ({"cpu.max": "50000 100000\n", "a/cpu.max": "max 100000\n"}, 1),
        ({"a/cpu.max": "9900000 100000\n"}, 8),
        ({"a/cpu.max": "max 100000\n"}, 8),
        ({"a/cpu.max": "many\n"}, 8),
        ({"a/cpu.max": "100000 0\n"}, 8),
        ({"a/cpu.max": ""}, 8),
        ({"cpu,cpuacct/b/cpu.cfs_quota_us": "300000\n", "cpu,cpuacct/b/cpu.cfs_period_us": "100000\n"}, 3),
        ({"cpu,cpuacct/b/cpu.cfs_quota_us": "-1\n", "cpu,cpuacct/b/cpu.cfs_period_us": "100000\n"}, 8),
    ],
)
def test_a_containers_share_of_the_processors_counts(limits, files, processors):
    limits(b"3:cpu,cpuacct:/b\n0::/a\n", files)
    assert room_here().processors == processors


def test_a_group_whose_name_is_no_utf_8_has_its_limit(limits):
    limits(b"0::/\xff\n", {"\udcff/memory.max": "2000000000\n", "\udcff/memory.current": "500000000\n"})
    assert room_here().memory == 1_500_000_000


def test_three_hundred_workers_of_one_processor_are_one_and_the_batch_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("fit.batch.runner.room_here", lambda: Room(processors=1, memory=None))
    started = []

    def no_cluster(workers):
        started.append(workers.count)
        raise KeyboardInterrupt

    monkeypatch.setattr("fit.batch.runner.connect", no_cluster)
    make_takes(tmp_path, 2)
    done = hangtime_here("batch", ".", "--out", "out", "--workers", 300, *SHORT, folder=tmp_path)
    assert (done.returncode, started) == (130, [1])
    assert "1 worker instead of 2: this machine has 1 processor for them, and each fit uses one." in done.stderr


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--hours", "inf"), "the value must be at most 8784"),
        (("--hours", "nan"), "--hours"),
        (("--hours", "9000"), "the value must be at most 8784"),
        (("--patience", "nan"), "--patience"),
        (("--patience", "inf"), "the value must be at most 10080"),
        (("--patience", "-1"), "the value must be at least 0"),
        (("--workers", "0"), "the value must be at least 1"),
        (("--workers", "-3"), "the value must be at least 1"),
        (("--workers", "2.5"), "--workers"),
        (("--workers", "2", "--scheduler", "tcp://127.0.0.1:9"), "--workers: changes nothing here"),
        (("--dashboard-port", "0", "--scheduler", "tcp://127.0.0.1:9"), "--dashboard-port: changes nothing here"),
        (  # told, and refused for the workers alone
            ("--iterations", "20", "--workers", "2", "--scheduler", "tcp://127.0.0.1:9"),
            "--iterations changes nothing here: least-squares has no number of iterations.\n",
        ),
        (("--iterations", "0"), "the value must be at least 1"),
        (("--iterations", "999999999999"), "--iterations"),
        (("--gamma", "nan"), "--gamma: gamma is nan; give a number above 0"),
        (("--gamma", "-1"), "--gamma: gamma is -1; give a number above 0"),
        (("--gamma", "inf"), "--gamma: gamma is inf; give a number above 0"),
        (("--spacing", "nan"), "the mesh spacing is nan m"),
        (("--spacing", "inf"), "the mesh spacing is inf m"),
        (("--seed", "-1"), "the value must be at least 0"),
        (("--dashboard-port", "99999"), "the value must be at most 65535"),
    ],
)
def test_a_number_without_a_meaning_is_refused_with_its_option_and_its_range(tmp_path, words, sentence):
    (tmp_path / "takes").mkdir()
    done = hangtime_here("batch", "takes", "--out", "out", *words, folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()
