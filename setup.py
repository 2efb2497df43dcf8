import os
import sys
from glob import glob

from setuptools import find_packages, setup

scripts = ["tire-dynamics = tire_dynamics.doors.cli:main"]
# `ros2 run tire_dynamics node` looks for this name in lib/tire_dynamics, where colcon's commands put it.
# pip puts scripts onto the PATH, where `node` is Node.js; there the same thing is `tire-dynamics node`.
if {"install", "develop"} & set(sys.argv):
    scripts.append("node = tire_dynamics.doors.cli:node")

# ROS 2 Jazzy comes as wheels for this platform only; elsewhere the extra installs nothing and a ROS
# installation provides rclpy.
ROS_WHEELS = "sys_platform == 'linux' and platform_machine == 'x86_64' and python_version < '3.15'"
DASK = "distributed>=2024.1"
SHTAB = "shtab>=1.9"  # which knows fish

config = [(folder, files) for folder, _, files in os.walk("config") if files]  # installed as it stands

setup(
    name="tire_dynamics",
    version="0.1.0",
    description="Real-time rotating-ring tire dynamics for ROS 2",
    maintainer="tire_dynamics maintainers",
    maintainer_email="maintainers@tire-dynamics.example",
    license="Apache-2.0",
    packages=find_packages(include=["tire_dynamics", "tire_dynamics.*"]),
    package_data={"tire_dynamics.doors.report": ["template.html"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tire_dynamics"]),
        ("share/tire_dynamics", ["package.xml"]),
        ("share/tire_dynamics/launch", glob("launch/*.launch.py")),
        *((f"share/tire_dynamics/{folder}", [f"{folder}/{file}" for file in files]) for folder, files in config),
    ],
    zip_safe=True,
    python_requires=">=3.10",
    # numpy and scipy from 1.26 and 1.11: those of Ubuntu 24.04, on which ROS 2 Jazzy stands
    install_requires=[
        "numpy>=1.26,<3",
        "scipy>=1.11",
        "PyYAML>=6.0",
        "mcap>=1.5",
        "lz4>=4.0",
        "zstandard>=0.20",
        "rosbags>=0.11",
        "rich>=13.0",  # progress and tables on a terminal: pure Python, small, and loaded only there
    ],
    extras_require={
        "ros": [
            f"ros-jazzy-rclpy[fastrtps]; {ROS_WHEELS}",
            f"ros-jazzy-common-interfaces; {ROS_WHEELS}",
        ],
        "plot": ["matplotlib>=3.6"],
        "fast": ["numba>=0.58"],  # the loops compiled; the results have the same bits without
        "report": ["plotly>=6.0"],  # it brings the plotly.js that goes into the page
        "cluster": [DASK],  # Dask: replays and maps on several machines
        "completion": [SHTAB],  # for the shells' Tab
        "colcon": ["colcon-common-extensions"],  # what `make colcon` builds with
        "interop": ["cyclonedds==11.0.1"],  # another vendor's DDS, for `make interop`
        "docs": ["mkdocs>=1.6,<2", "mkdocs-material>=9.5,<10", "mkdocstrings-python>=2.0,<3", "latex2mathml>=3.78"],
        "test": [
            "pytest>=7.4", "pytest-xdist", "hypothesis>=6.98", "catkin_pkg", "playwright>=1.40", "ruff", "mypy",
            "types-PyYAML", "scipy-stubs", DASK, SHTAB,
        ],  # fmt: skip
    },
    entry_points={"console_scripts": scripts},
)
