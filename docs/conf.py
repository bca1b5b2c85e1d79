"""How Sphinx builds these pages: `make docs`. They run what they show, and warnings fail."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

import generated  # noqa: E402
import running  # noqa: E402

import sysid  # noqa: E402

# For the notebooks' kernels, whose plots are shown below their cells; commands draw with agg.
INLINE = "module://matplotlib_inline.backend_inline"
os.environ.update(
    running.environment(HERE.parent) | {"SYSID_PROJECT": str(HERE.parent), "MPLBACKEND": INLINE}
)

# Public recordings are not part of the project: without them one notebook is shown, not run.
HAS_EMPS = (HERE.parent.parent / "shared" / "data" / "emps").is_dir()

project = "sysid"
release = version = sysid.__version__
language = "en"
# Parts of pages, which include them.
exclude_patterns = ["_ext", "_static", *(f"reference/generated/{n}" for n in generated.INCLUDED)]

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx_click",
    "mathml",
    "running",
    "generated",
]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb", ".rst": "restructuredtext"}

myst_enable_extensions = ["dollarmath", "substitution"]
_RUN = "The recordings were next to the project when this page was built: all cells were run."
_SKIPPED = (
    "**Skipped:** the recordings were not next to the project when this page was built (they go "
    "into `../shared/data/emps`), so the cells are shown without their output."
)
myst_substitutions = {"emps": _RUN if HAS_EMPS else _SKIPPED}
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_excludepatterns = ["*.md", *([] if HAS_EMPS else ["*emps-friction*"])]
nb_execution_in_temp = True
nb_merge_streams = True

html_theme = "furo"
html_title = "sysid"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_math_renderer = "mathml"
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_show_sourcelink = False

# Docstrings are plain text with single backquotes for code.
default_role = "code"
autodoc_typehints = "none"
autodoc_member_order = "alphabetical"
add_module_names = False
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]
