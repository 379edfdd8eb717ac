"""Install mapdeal into a ROS 2 workspace, with the setuptools of Ubuntu.

colcon-core recognises a Python package by a setup.py that contains the text "setup()".
"""

import sys
from pathlib import Path

from setuptools import Extension, find_packages, setup

ROOT = Path("../..")  # the checkout; setuptools runs in this folder
SOURCES = ROOT / "src"
sys.path.insert(0, str(ROOT / ".backend"))
try:
    from mapdeal_build import BuildKernels
except ImportError:  # without Cython numpy and scipy do the work of the kernels
    kernels, commands = [], {}
else:
    commands = {"build_ext": BuildKernels}
    folder = (SOURCES / "mapdeal/kernels").resolve()  # Cython loses its way between two ".."
    kernels = [
        Extension(
            f"mapdeal.kernels.{path.stem}", [str(path)], include_dirs=[str(folder)], optional=True
        )
        for path in sorted(folder.glob("*.pyx"))
    ]
version = {}
exec((SOURCES / "mapdeal/version.py").read_text("utf-8"), version)  # noqa: S102 - our own file

setup(
    name="mapdeal",
    version=version["__version__"],
    packages=find_packages(str(SOURCES)),
    package_dir={"": str(SOURCES)},
    package_data={
        "mapdeal": [
            "py.typed",
            "*.pyi",
            "kernels/*.pyi",
            "pipeline/recipes/*.yaml",
            "report/page/*",
        ]
    },
    ext_modules=kernels,
    cmdclass=commands,
    entry_points={"console_scripts": ["mapdeal = mapdeal.cli.process:run_process"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/mapdeal"]),
        ("share/mapdeal", ["package.xml"]),
    ],
)
