"""The build backend: setuptools, with two additions that pyproject.toml cannot express.

Each compiler gets its own flags, and the source distribution contains everything that the tests
and the documentation need.
"""

import os

from Cython.Build import cythonize
from project_sources import project_files
from setuptools.build_meta import *  # noqa: F403 - the hooks of a build backend
from setuptools.command.build_ext import build_ext
from setuptools.command.sdist import sdist

# Products are not fused into sums: results equal numpy's to the last bit.
FLAGS = {
    "msvc": ["/O2", "/fp:precise", "/std:c11"],
    "unix": ["-O3", "-ffp-contract=off", "-fno-math-errno", "-g0"],
}


class BuildKernels(build_ext):
    """Compile the kernels with the flags of the compiler at hand, several at a time."""

    def build_extensions(self):
        """Write the C code into the temporary folder, and compile all modules.

        With MAPDEAL_KERNELS=scipy there are none, and the installation takes seconds.
        """
        if os.environ.get("MAPDEAL_KERNELS") == "scipy":
            self.extensions = []
            return
        for ext in self.extensions:
            ext.sources = cythonize([ext], build_dir=self.build_temp, quiet=True)[0].sources
        if self.parallel is None:
            self.parallel = True  # as many as there are processors
        super().build_extensions()

    def build_extension(self, ext):
        """Compile one module; one that is optional may fail."""
        kind = self.compiler.compiler_type
        ext.extra_compile_args = FLAGS["msvc" if kind == "msvc" else "unix"]
        super().build_extension(ext)


class SourceDistribution(sdist):
    """Pack all that the tests, the documentation and CI need."""

    def make_distribution(self):
        """Add the project's files to those that setuptools finds by itself."""
        self.filelist.extend(project_files())
        self.filelist.sort()
        self.filelist.remove_duplicates()
        super().make_distribution()
