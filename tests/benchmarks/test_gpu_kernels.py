"""The program that sanitizers watch runs without a GPU, too."""

import gpu_kernels


def test_the_program_that_sanitizers_watch_runs(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["gpu_kernels.py", "cpu"])
    assert gpu_kernels.main() == 0
    assert capsys.readouterr().out == "all kernels have run\n"
