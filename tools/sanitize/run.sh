#!/bin/sh
# Runs pytest with a sanitized build of isolux on the system's Python.
#     tools/sanitize/run.sh address|thread SITE_PACKAGES PYTHON TESTS...
set -eu
kind=$1
export PYTHONPATH="$PWD/build/sanitize-$kind/installed:$PWD/$2"
python=$3
shift 3

# Python itself is not instrumented, so the runtime has to come first; ASan looks for the C++
# library's throw, which Python alone would not have loaded.
libcxx=$(g++ -print-file-name=libstdc++.so.6)
# What is written to stderr itself stays there, or a report would be lost with its process.
pytest="-m pytest -p no:cacheprovider --capture=sys"
case $kind in
address)
    # Leaks are not looked for: Python and USD keep what they have until they end.
    LD_PRELOAD="$(g++ -print-file-name=libasan.so) $libcxx" \
        ASAN_OPTIONS=detect_leaks=0:detect_stack_use_after_return=1 \
        UBSAN_OPTIONS=print_stacktrace=1 \
        exec "$python" $pytest "$@"
    ;;
thread)
    # TSan wants its part of the address space, which a random layout may have taken. NumPy's
    # OpenBLAS is not instrumented: what its threads write for us would look like a race.
    OPENBLAS_NUM_THREADS=1 LD_PRELOAD="$(g++ -print-file-name=libtsan.so) $libcxx" \
        TSAN_OPTIONS="suppressions=$PWD/$(dirname "$0")/thread.txt" \
        exec setarch -R "$python" $pytest "$@"
    ;;
esac
