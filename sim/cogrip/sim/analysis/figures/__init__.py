"""Figures of the analysis: a module a subject, a function a page; `page.save_page` writes picture and numbers together."""
