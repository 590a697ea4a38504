"""Settings of Sphinx; ``python website`` builds the site with them."""

from datetime import datetime, timezone
from importlib.metadata import version as version_of

project = "gsfw"
version = release = version_of("gsfw")
copyright = f"{datetime.now(tz=timezone.utc).year}, the authors of gsfw; Apache-2.0"

extensions = ["myst_parser", "sphinx_copybutton"]
myst_heading_anchors = 4  # As GitHub spells them, so that links work in both places.
myst_enable_extensions = ["attrs_inline"]
nitpicky = True

html_theme = "furo"
html_title = "gsfw"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
templates_path: list[str] = []
highlight_language = "text"  # Of blocks without a language: output of programs.
pygments_style = "friendly"
pygments_dark_style = "github-dark"

copybutton_exclude = ".linenos, .gp, .c1"  # A copied command has no comment behind it.
