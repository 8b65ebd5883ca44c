"""Figures of the analysis: a module a subject; `page.save_page` writes picture and numbers together."""
