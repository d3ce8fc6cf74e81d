"""What is put before a customer in the morning: one self-contained HTML page, and its figures.

`page` lays out one session, `compare` several; `figures` draws, `words` turns results into the
sentences and cells of the page. Nothing is fetched when the page is opened.
"""
