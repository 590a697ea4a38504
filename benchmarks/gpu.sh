#!/usr/bin/env bash
# Measures gsfw on a machine with a GPU, in one command; docs/guides/gpu.md says how.
exec "${PYTHON:-python3}" "$(dirname "$0")/gpu.py" "$@"
