#!/bin/sh
# The core on aarch64, on a machine that is none: cross-compiled as a wheel, run by qemu with the distribution's Python and
# NumPy's wheel. Its replay of the sample bag has to be the one of this machine, byte for byte, and the tests of the core pass.
#
# For Debian and Ubuntu, whose Python has to be of the version of $VENV's. What it needs of the system, once, as root:
#     dpkg --add-architecture arm64 && apt-get update && apt-get install qemu-user-static gcc-aarch64-linux-gnu
set -eu

TESTS="test_stepping test_wheel_estimator test_belt test_vehicle test_wheel test_drive test_road_motion test_uniformity \
test_simulate test_reference_values test_messages"

for program in aarch64-linux-gnu-gcc qemu-aarch64-static apt-get dpkg-deb; do
    command -v $program > /dev/null || { echo "There is no $program; test/aarch64.sh says how to get it." >&2; exit 1; }
done
VERSION=$("$VENV/bin/python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
HERE=$PWD
rm -rf build/aarch64
mkdir -p build/aarch64/debs build/aarch64/sysroot build/aarch64/source build/aarch64/sysconfig
cd build/aarch64
BUILD=$PWD

echo "== Python $VERSION for aarch64"
for package in python$VERSION-minimal libpython$VERSION-minimal libpython$VERSION-stdlib libpython$VERSION-dev libpython$VERSION \
    libc6 libgcc-s1 libstdc++6 zlib1g libexpat1 libffi8 libbz2-1.0 liblzma5 libssl3 libuuid1 libsqlite3-0; do
    (cd debs && apt-get download -q -q "$package:arm64")
done
for package in debs/*.deb; do dpkg-deb -x "$package" sysroot; done
cp sysroot/usr/lib/python$VERSION/_sysconfigdata__aarch64-linux-gnu.py sysconfig/
"$VENV/bin/python" -m pip download --quiet --disable-pip-version-check --only-binary=:all: --dest wheels \
    --python-version "$VERSION" --platform manylinux_2_28_aarch64 --platform manylinux_2_27_aarch64 \
    --platform manylinux2014_aarch64 --platform any \
    numpy scipy pyyaml zstandard lz4 mcap rosbags pytest 'hypothesis>=6.100'

echo "== the wheel"
git -C "$HERE" archive HEAD | tar -x -C source
(
    cd source
    export PYTHONPATH="$BUILD/sysconfig" _PYTHON_SYSCONFIGDATA_NAME=_sysconfigdata__aarch64-linux-gnu
    export _PYTHON_HOST_PLATFORM=linux-aarch64 CC=aarch64-linux-gnu-gcc LDSHARED="aarch64-linux-gnu-gcc -shared"
    export CFLAGS="-I$BUILD/sysroot/usr/include/python$VERSION -I$BUILD/sysroot/usr/include"
    "$VENV/bin/python" setup.py --quiet bdist_wheel --plat-name linux_aarch64 --dist-dir "$BUILD/wheels" 2> "$BUILD/wheel.log" ||
        { cat "$BUILD/wheel.log" >&2; exit 1; }
)
for wheel in wheels/*.whl; do "$VENV/bin/python" -m zipfile -e "$wheel" site; done
(cd site && find tire_dynamics -name '*.so' -exec cp {} "$BUILD/source/{}" \;)
if find site/tire_dynamics -name '*.so' -exec aarch64-linux-gnu-objdump -d {} + | grep -E '[[:space:]]fn?m(add|sub)[[:space:]]'; then
    echo "Products and sums are fused." >&2
    exit 1
fi

emulated() {
    PYTHONPATH="$BUILD/site" OPENBLAS_NUM_THREADS=1 qemu-aarch64-static -L "$BUILD/sysroot" "sysroot/usr/bin/python$VERSION" "$@"
}

echo "== a replay there and here"
emulated -c 'import platform; print(platform.machine())'
emulated -m tire_dynamics.build_state
emulated -m tire_dynamics.cli.main replay "$HERE/bags/sample" -o there
"$VENV/bin/python" -m tire_dynamics.cli.main replay "$HERE/bags/sample" -o here
"$VENV/bin/python" - <<'END'
from mcap.reader import make_reader


def messages(path):
    with open(path, "rb") as file:
        return [(c.topic, m.log_time, m.publish_time, m.data) for _, c, m in make_reader(file).iter_messages()]


there, here = messages("there/there_0.mcap"), messages("here/here_0.mcap")
if not here or there != here:
    unequal = sum(a != b for a, b in zip(there, here))
    raise SystemExit(f"{len(there)} messages there and {len(here)} here, of which {unequal} differ")
print(f"{len(here)} messages, the same bytes")
END

echo "== tests of the core there"
cd source
PYTHONPATH="$BUILD/source:$BUILD/site" OPENBLAS_NUM_THREADS=1 qemu-aarch64-static -L "$BUILD/sysroot" \
    "$BUILD/sysroot/usr/bin/python$VERSION" -m pytest -q -p no:cacheprovider -m 'not live and not slow and not nightly' \
    $(for name in $TESTS; do echo "test/$name.py"; done)
