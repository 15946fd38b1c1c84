"""The lessons: pages, figures and texts about the two-joint arm of every course on motion planning.

`lesson_catalog.py` lists them. A lesson is one module `<name>_lesson.py` with a subclass of `Lesson` that computes the
content, lists the steps and draws the figure; the page's own drawing code is in `page/<name>_lesson.js` and
`page/<name>_lesson.css`.
"""
