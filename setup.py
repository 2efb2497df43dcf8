import os
import re
import runpy
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from glob import glob
from pathlib import Path

import setuptools
from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext

BUILD_STATE = runpy.run_path("tire_dynamics/build_state.py")

# Sums and products are neither fused nor reordered, whatever CFLAGS say: the same bits everywhere. Nothing here is made
# for the processor at hand (-march=native), for the same reason.
FLAGS = ["-O3", "-fno-fast-math", "-ffp-contract=off", "-g0"]  # -g0 halves the time
FLAGS_MSVC = ["/O2", "/fp:precise"]
EXT_SUFFIX = sysconfig.get_config_var("EXT_SUFFIX")


class BuildCore(build_ext):
    """Compiles the core; where that cannot be, the installation goes on, and the same source runs interpreted."""

    def run(self):
        in_place, core = self.inplace, self.extensions
        if in_place and not self.force:  # pip's build leaves nothing in build/ that would say so
            beside = {each.name: Path(*each.name.split(".")).with_suffix(EXT_SUFFIX) for each in self.extensions}
            self.extensions = [each for each in self.extensions if is_outdated(each, beside[each.name])]
        try:
            super().run()
        except Exception as error:
            # All or nothing; and nothing may stay that was compiled before a change of the source.
            self.inplace = False
            for extension in core:
                built = self.get_ext_fullpath(extension.name)
                beside = os.path.join(os.path.dirname(extension.name.replace(".", os.sep)), os.path.basename(built))
                for file in [built, beside] if in_place else [built]:
                    if os.path.exists(file):
                        os.remove(file)
            self.extensions = []
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
            print(BUILD_STATE["how_to_compile"](building=True), file=sys.stderr)

    def build_extensions(self):
        if not BUILD_STATE["cython_suits"]():
            raise ModuleNotFoundError("no Cython, or an old one")
        from Cython.Build import cythonize

        self.check_extensions_list(self.extensions)
        build = super().build_extension
        # The C compiler runs once for each processor, while Cython, which is one thread's, goes on; the longest first.
        with ThreadPoolExecutor(self.parallel if type(self.parallel) is int else os.cpu_count()) as pool:
            jobs = []
            for extension in sorted(self.extensions, key=lambda each: -os.path.getsize(each.sources[0])):
                if not self.force and not is_outdated(extension, Path(self.get_ext_fullpath(extension.name))):
                    continue  # Cython would do it again, whose own files are new in each environment that pip makes
                extension.extra_compile_args = FLAGS_MSVC if self.compiler.compiler_type == "msvc" else FLAGS
                # The C code goes to build/, not beside its source.
                [made] = cythonize(
                    [extension],
                    build_dir=os.path.join("build", "cython"),
                    force=self.force,
                    quiet=True,
                    compiler_directives={"show_performance_hints": False},  # whoever installs this reads what is said
                )
                extension.sources = made.sources
                jobs.append(pool.submit(build, extension))
            for job in jobs:
                job.result()


def is_outdated(extension, compiled):
    """Whether a file that was compiled is older than its source, or is not there."""
    since = max(os.path.getmtime(file) for file in [*extension.sources, *extension.depends])
    return not compiled.exists() or compiled.stat().st_mtime < since


def extension(module):
    source = os.path.join(*module.split("."))
    return Extension(module, [f"{source}.py"], depends=["setup.py", *glob("tire_dynamics/**/*.pxd", recursive=True)])


# What ROS's keys do not bring, and nothing needs: colcon and Debian's tools would look for it.
BY_PIP = ["mcap>=1.5", "lz4>=4.0", "zstandard>=0.20", "rosbags>=0.11"]
scripts = ["tire-dynamics = tire_dynamics.cli.main:main"]
# `ros2 run tire_dynamics node` looks for this name in lib/tire_dynamics, where colcon's commands put it.
# pip puts scripts onto the PATH, where `node` is Node.js; there the same thing is `tire-dynamics node`.
if {"install", "develop"} & set(sys.argv):
    scripts.append("node = tire_dynamics.cli.main:node")
    BY_PIP = []

# ROS 2 Jazzy comes as wheels for this platform only; elsewhere the extra installs nothing and a ROS
# installation provides rclpy.
ROS_WHEELS = "sys_platform == 'linux' and platform_machine == 'x86_64' and python_version < '3.15'"
# What CMake needs to build a package of messages and services against these wheels.
GENERATORS = (
    "ament-cmake", "ament-cmake-gmock", "ament-cmake-gtest", "ament-cmake-include-directories", "ament-cmake-pytest",
    "ament-cmake-ros", "ament-package", "python-cmake-module", "rosidl-core-generators", "rosidl-default-generators",
)  # fmt: skip
INTERFACES = [*(f"ros-jazzy-{name}; {ROS_WHEELS}" for name in GENERATORS), "catkin_pkg", "empy>=3.3,<4"]
DASK = "distributed>=2024.1"
SHTAB = "shtab>=1.9"  # which knows fish
CYTHON = "Cython>=" + ".".join(map(str, BUILD_STATE["CYTHON"]))
SETUPTOOLS = "setuptools>=70.1,<80"  # makes wheels by itself; takes colcon's `setup.py develop --editable`

URL = "https://tire-dynamics.example/tire_dynamics"


def long_description():
    """The README for a page that lies elsewhere: its links lead into the repository, its pictures come from there."""
    text = Path("README.md").read_text(encoding="utf-8")
    text = re.sub(r"!\[([^]]*)\]\((?!https?:)", rf"![\1]({URL}/raw/main/", text)
    return re.sub(r"(?<!!)\[([^]]*)\]\((?!https?:|#)", rf"[\1]({URL}/blob/main/", text)


# As a licence expression (PEP 639) where setuptools knows these.
LICENSE = {"license_expression" if int(setuptools.__version__.partition(".")[0]) >= 77 else "license": "Apache-2.0"}

config = [(folder, files) for folder, _, files in os.walk("config") if files]  # installed as it stands

setup(
    name="tire_dynamics",
    version="0.1.0",
    description="Real-time rotating-ring tire dynamics for ROS 2",
    maintainer="tire_dynamics maintainers",
    maintainer_email="maintainers@tire-dynamics.example",
    **LICENSE,
    license_files=["LICENSE"],
    long_description=long_description(),
    long_description_content_type="text/markdown",
    url="https://tire-dynamics.example",
    project_urls={
        "Documentation": f"{URL}/blob/main/docs/api/index.md",
        "Source": URL,
        "Issues": f"{URL}/issues",
        "Changelog": f"{URL}/blob/main/CHANGELOG.md",
    },
    keywords=["tire", "vehicle dynamics", "rotating ring", "Floquet", "ROS 2", "MCAP"],
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Science/Research",
        "Intended Audience :: Manufacturing",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Cython",
        "Programming Language :: Python :: 3",
        *(f"Programming Language :: Python :: 3.{minor}" for minor in range(10, 15)),
        "Topic :: Scientific/Engineering :: Physics",
        "Typing :: Typed",
    ],
    packages=find_packages(include=["tire_dynamics", "tire_dynamics.*"]),
    package_data={"tire_dynamics": ["py.typed"], "tire_dynamics.report": ["*.html"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tire_dynamics"]),
        ("share/tire_dynamics", ["package.xml"]),
        ("share/tire_dynamics/launch", glob("launch/*.launch.py")),
        ("share/tire_dynamics/bags/sample", glob("bags/sample/*")),
        *((f"share/tire_dynamics/{folder}", [f"{folder}/{file}" for file in files]) for folder, files in config),
    ],
    ext_modules=[extension(module) for module in BUILD_STATE["CORE"]],
    cmdclass={"build_ext": BuildCore},
    zip_safe=False,
    python_requires=">=3.10",
    # numpy and scipy from 1.26 and 1.11: those of Ubuntu 24.04, on which ROS 2 Jazzy stands
    install_requires=[
        "numpy>=1.26,<3",
        "scipy>=1.11",
        "PyYAML>=6.0",
        *BY_PIP,
        "rich>=13.0",  # progress and tables on a terminal: pure Python, small, and loaded only there
    ],
    extras_require={
        "ros": [
            f"ros-jazzy-rclpy[fastrtps]; {ROS_WHEELS}",
            f"ros-jazzy-common-interfaces; {ROS_WHEELS}",
        ],
        "interfaces": [*INTERFACES],  # what builds message packages: `make colcon`, and a test
        "plot": ["matplotlib>=3.6"],
        "report": ["plotly>=6.0", "Jinja2>=3.0"],  # Plotly brings the plotly.js that goes into the page
        "mdf": ["asammdf>=7.4"],  # MDF4 files for `compare`
        "cluster": [DASK],  # Dask: replays and maps on several machines
        "completion": [SHTAB],  # for the shells' Tab
        "build": [SETUPTOOLS, CYTHON],  # what compiles the core again where it changes, in a clone
        "colcon": ["colcon-common-extensions", SETUPTOOLS, CYTHON],  # what `make colcon` builds with
        # another vendor's DDS, ROS's release tool, checks of the project's files: for `make interop`
        "interop": [
            "cyclonedds==11.0.1", "bloom>=0.13", "check-jsonschema>=0.33", "build>=1.2", "twine>=6.1",
            "cibuildwheel>=2.23; python_version >= '3.11'",
        ],  # fmt: skip
        "docs": ["mkdocs>=1.6,<2", "mkdocs-material>=9.5,<10", "mkdocstrings-python>=2.0,<3", "latex2mathml>=3.78"],
        "test": [
            "pytest>=7.4", "pytest-xdist", "hypothesis>=6.98", "catkin_pkg", "playwright>=1.40", "ruff", "mypy",
            "asammdf>=7.4", "commonroad-vehicle-models>=3.0", "types-PyYAML", "scipy-stubs",
            DASK, SHTAB, SETUPTOOLS, CYTHON,
        ],  # fmt: skip
    },
    entry_points={"console_scripts": scripts},
)
