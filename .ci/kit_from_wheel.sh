#!/usr/bin/env bash
# The plugin kit from the built wheel, in a new environment and an empty folder: the tutorial from its first line to its last.
# With a folder as its argument, of an environment in which the wheel is installed, it makes neither.
set -euo pipefail
cd "$(dirname "$0")/.."
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore PIP_NO_WARN_SCRIPT_LOCATION=1
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
if [ "$#" -gt 0 ]; then
  environment=$(realpath "$1")
else
  environment=$out/venv
  python3 -m venv "$out/build"
  "$out/build/bin/pip" install -q build
  "$out/build/bin/python" -m build -q --wheel --outdir "$out" .
  python3 -m venv "$environment"
  "$environment/bin/pip" install -q "$out"/*.whl
fi
cp docs/tutorials/plugin-in-a-day.md tests/scaffold/tutorial.py "$out"
cd "$out"
env -u PYTHONPATH "$environment/bin/python" tutorial.py plugin-in-a-day.md "$out/work"
