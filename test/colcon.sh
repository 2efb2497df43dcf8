#!/usr/bin/env bash
# The package as a ROS user gets it: built and tested by colcon in a fresh workspace, started from where colcon put it,
# with the parameter file that the ament index finds. `make colcon` runs this on the wheels in .venv.
set -euo pipefail
repository=$(cd "$(dirname "$0")/.." && pwd)
workspace=$(mktemp -d)
node=
trap 'if [ -n "$node" ]; then kill -KILL "$node" 2>/dev/null || true; fi; rm -rf "$workspace"' EXIT

fail() {
    echo "colcon: $*" >&2
    exit 1
}

export VIRTUAL_ENV=${VENV:-$repository/.venv}
export AMENT_PREFIX_PATH=$VIRTUAL_ENV # the wheels do not say where they are
export PATH=$VIRTUAL_ENV/bin:$PATH
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-$((RANDOM % 100 + 1))} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
export ROS_LOG_DIR=$workspace/ros_log
export COLCON_LOG_PATH=$workspace/log COLCON_HOME=$workspace/home

echo "== build"
source=$workspace/src/tire_dynamics
mkdir -p "$source"
(cd "$repository" && git ls-files -z --cached --others --exclude-standard |
    while IFS= read -r -d '' file; do if [ -e "$file" ]; then printf '%s\0' "$file"; fi; done |
    xargs -0 cp --parents -t "$source")
cd "$workspace"
colcon list | grep -q '^tire_dynamics.*(ros.ament_python)$' || fail "not an ament_python package: $(colcon list)"
paths="src $source/interfaces $source/test/interfaces" # colcon does not look for packages below a package
colcon --log-level error build --base-paths $paths --cmake-args -DCMAKE_PREFIX_PATH="$VIRTUAL_ENV" \
    -DPython3_EXECUTABLE="$VIRTUAL_ENV/bin/python" -DCMAKE_PROJECT_INCLUDE="$source/interfaces/wheels.cmake" ||
    fail "the build failed"
set +u
. install/setup.bash
set -u

echo "== test"
files="test/test_package.py test/test_launch.py test/test_lifecycle.py"
colcon --log-level error test --pytest-args $files # a part: `make test` runs them all, on the same wheels
colcon test-result --verbose || fail "tests failed"
ran=$(colcon test-result | sed -n 's/^Summary: \([0-9]*\) tests.*/\1/p')
[ "${ran:-0}" -ge 50 ] || fail "only ${ran:-no} tests ran"

echo "== fields" # the node, as installed, beside the messages that were built
python -m pytest -q -n 0 -p no:cacheprovider "$source/test/interfaces" || fail "the tests with messages failed"

echo "== run"
cd / # not in the source: what runs is what was installed
share=$(python -c 'from ament_index_python import get_package_share_directory as share; print(share("tire_dynamics"))')
used=$(python -c 'import tire_dynamics; print(tire_dynamics.__file__)')
case $share:$used in
"$workspace"/install/*:"$workspace"/install/*) ;;
*) fail "not what colcon installed: $share, $used" ;;
esac
python -m tire_dynamics.build_state || ! command -v "${CC:-gcc}" >/dev/null || fail "the core is not compiled"
for file in config/vehicle.yaml launch/tire_dynamics.launch.py bags/sample/metadata.yaml package.xml; do
    [ -f "$share/$file" ] || fail "$file is not installed"
done
"$workspace/install/tire_dynamics/lib/tire_dynamics/tire-dynamics" info "$share/bags/sample" || fail "no command"
executable=$workspace/install/tire_dynamics/lib/tire_dynamics/node
"$executable" --ros-args --params-file "$share/config/vehicle.yaml" -p log.directory:="$workspace/runs" &
node=$!
for _ in $(seq 300); do
    kill -0 "$node" 2>/dev/null || break
    if compgen -G "$workspace/runs/*/*.mcap" >/dev/null; then break; fi
    sleep 0.2
done
compgen -G "$workspace/runs/*/*.mcap" >/dev/null || fail "the node does not run"
sleep 1
kill -INT "$node"
status=0
wait "$node" || status=$?
node=
[ "$status" -eq 0 ] || fail "SIGINT ended the node with status $status"
[ -f "$workspace"/runs/*/metadata.yaml ] || fail "the log was not closed"

status=0
"$executable" --ros-args --params-file "$share/config/vehicle.yaml" -p rate_hz:=-1.0 2>"$workspace/said" || status=$?
cat "$workspace/said"
[ "$status" -eq 2 ] || fail "a bad parameter ended the node with status $status"
[ "$(grep -cv '^\[INFO\]' "$workspace/said")" -eq 1 ] || fail "a bad parameter should give one line"
grep -q 'rate_hz' "$workspace/said" || fail "that line does not name the parameter"
echo "== colcon: built, $ran tests, runs from install/, config found through the ament index"
