"""The same scene in other programs: illuminance at the same points, for `tools/bench_peers.py`.

`export.py` writes what the solver reads of a stage as plain arrays; each peer runs in a process of
its own (`worker.py`), which holds nothing of Isolux.
"""
