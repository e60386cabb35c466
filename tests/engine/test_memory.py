"""Memory that can be taken, on made-up machines and containers."""

from __future__ import annotations

from pathlib import Path

import pytest

from photosite.engine.memory import AvailableMemory, available_memory

MEMINFO = "MemTotal:       16000 kB\nMemFree:         1000 kB\nMemAvailable:    8000 kB\n"
STAT_1 = "cache 999\ninactive_file 5\ntotal_inactive_file 3000\ntotal_active_file 1000\n"
STAT_2 = "anon 999\nfile 5000\ninactive_file 3000\nactive_file 1000\n"


def machine(root: Path, files: dict[str, str]) -> Path:
    for name, text in {"proc/meminfo": MEMINFO, **files}.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


def test_a_machine_without_limits(tmp_path: Path) -> None:
    assert available_memory(machine(tmp_path, {})) == AvailableMemory(8_192_000, of_container=False)
    assert available_memory(tmp_path / "none") is None


def test_limit_of_version_2_without_cached_files(tmp_path: Path) -> None:
    group = "sys/fs/cgroup/user/job"
    files = {"memory.max": "1000000\n", "memory.current": "300000\n", "memory.stat": STAT_2}
    root = machine(tmp_path, {"proc/self/cgroup": "0::/user/job\n", **{f"{group}/{k}": v for k, v in files.items()}})
    assert available_memory(root) == AvailableMemory(704_000, of_container=True)
    (root / group / "memory.max").write_text("max\n")
    assert available_memory(root) == AvailableMemory(8_192_000, of_container=False)


def test_the_group_above_limits_too(tmp_path: Path) -> None:
    files = {
        "proc/self/cgroup": "0::/user/job\n",
        "sys/fs/cgroup/user/job/memory.max": "900000\n",
        "sys/fs/cgroup/user/job/memory.current": "0\n",
        "sys/fs/cgroup/user/memory.max": "500000\n",
        "sys/fs/cgroup/user/memory.current": "100000\n",
    }
    assert available_memory(machine(tmp_path, files)) == AvailableMemory(400_000, of_container=True)


@pytest.mark.parametrize("path", ["/job", "/host/path/of/the/container"])
def test_limit_of_version_1_also_where_the_path_is_the_hosts(tmp_path: Path, path: str) -> None:
    folder = "sys/fs/cgroup/memory" + (path if path == "/job" else "")
    files = {
        "proc/self/cgroup": f"9:name=systemd:/\n4:cpu,memory:{path}\n0::/\n",
        f"{folder}/memory.limit_in_bytes": "1000000\n",
        f"{folder}/memory.usage_in_bytes": "300000\n",
        f"{folder}/memory.stat": STAT_1,
    }
    assert available_memory(machine(tmp_path, files)) == AvailableMemory(704_000, of_container=True)


def test_no_limit_of_version_1_is_a_large_number(tmp_path: Path) -> None:
    files = {
        "proc/self/cgroup": "4:memory:/\n",
        "sys/fs/cgroup/memory/memory.limit_in_bytes": "9223372036854771712\n",
        "sys/fs/cgroup/memory/memory.usage_in_bytes": "300000\n",
    }
    assert available_memory(machine(tmp_path, files)) == AvailableMemory(8_192_000, of_container=False)


def test_a_group_that_is_over_its_limit_leaves_nothing(tmp_path: Path) -> None:
    files = {
        "proc/self/cgroup": "0::/\n",
        "sys/fs/cgroup/memory.max": "1000\n",
        "sys/fs/cgroup/memory.current": "3000\n",
    }
    assert available_memory(machine(tmp_path, files)) == AvailableMemory(0, of_container=True)
