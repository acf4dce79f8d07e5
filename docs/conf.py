"""Sphinx's settings: plain Markdown in, a site out that opens from disk, without network."""

import sys
from importlib import metadata
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "extensions")]

project = "nrsfm"
release = version = metadata.version("nrsfm")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "docstrings", "generated", "svgmath"]
exclude_patterns = ["extensions", "static"]

myst_enable_extensions = ["dollarmath", "deflist"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
myst_dmath_double_inline = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {name: name for name in ("Array", "Labels", "Mask", "Square", "Progress", "Fetch", "Answer")}
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True, "show-inheritance": True, "ignore-module-all": True}
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
add_module_names = False
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"{project} {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_math_renderer = "svg"
html_copy_source = html_show_search_summary = False  # a summary would be fetched, which a file may not
html_show_sourcelink = False
html_show_sphinx = html_show_copyright = False
suppress_warnings = ["ref.python"]  # of two classes of one name in an annotation, either is linked
highlight_language = "none"
pygments_style = "friendly"
pygments_dark_style = "monokai"
