"""Configuration of Sphinx for the documentation site; `python docs/make_site.py` builds it."""

from __future__ import annotations

import sys
from pathlib import Path

import rr1plan

sys.path.insert(0, str(Path(__file__).resolve().parent))  # for site_extension

project = "rr1plan"
author = "the rr1plan developers"
version = release = rr1plan.__version__
html_title = f"rr1plan {version}"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode", "site_extension"]
myst_heading_anchors = 4
default_role = "py:obj"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
napoleon_numpy_docstring = False
html_theme = "furo"
html_favicon = "site.svg"
html_static_path = ["site.css", "site.js"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_show_sourcelink = False
html_show_copyright = False
html_copy_source = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#c2410c", "color-brand-content": "#c2410c"},
    "dark_css_variables": {"color-brand-primary": "#fb923c", "color-brand-content": "#fb923c"},
}
