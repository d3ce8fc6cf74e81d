"""What is put before a customer in the morning: one self-contained HTML page, and its pictures.

`page` lays out one session and lists what there is to draw, `compare` lays out several; `words`
turns results into the sentences and cells of the page. `curve_pictures` and `data_pictures` draw,
and a `picture` goes into the page or into files of its own. Nothing is fetched when the page is
opened.
"""
