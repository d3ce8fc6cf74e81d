"""What is put before a customer in the morning: one self-contained HTML page, and its pictures.

`page` lays out one session, `compare` several; `words` turns results into the sentences and cells
of the page. `gallery` lists what there is to draw, `curve_pictures` and `data_pictures` draw it,
and a `picture` goes into the page or into files of its own. Nothing is fetched when the page is
opened.
"""
