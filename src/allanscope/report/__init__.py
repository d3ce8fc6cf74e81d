"""What is put before a customer in the morning: one self-contained HTML page, and its pictures.

`page` lays out one session and lists what there is to draw, `compare` lays out several; `axis_text`
turns results into the sentences and cells of the page, `chain` says which way a sample
took to them. `curve_pictures`, `data_pictures` and
`method_pictures` draw, and a `picture` goes into the page or into files of its own. Nothing is
fetched when the page is opened.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.report.chain import (
        ChainStep,
        processing_chain,
    )
    from allanscope.report.compare import (
        comparing_pictures,
        render_comparison,
    )
    from allanscope.report.method_pictures import (
        chain_picture,
        slopes_picture,
        transfer_picture,
    )
    from allanscope.report.page import (
        pictures,
        render,
        save_pictures,
        template,
    )
    from allanscope.report.picture import (
        DATASHEET,
        MEASURED,
        MODEL,
        Picture,
        ink,
    )

__all__ = [
    "DATASHEET",
    "MEASURED",
    "MODEL",
    "ChainStep",
    "Picture",
    "chain_picture",
    "comparing_pictures",
    "ink",
    "pictures",
    "processing_chain",
    "render",
    "render_comparison",
    "save_pictures",
    "slopes_picture",
    "template",
    "transfer_picture",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "DATASHEET": "picture",
        "MEASURED": "picture",
        "MODEL": "picture",
        "Picture": "picture",
        "comparing_pictures": "compare",
        "ink": "picture",
        "pictures": "page",
        "processing_chain": "chain",
        "render": "page",
        "render_comparison": "compare",
        "save_pictures": "page",
        "ChainStep": "chain",
        "chain_picture": "method_pictures",
        "slopes_picture": "method_pictures",
        "template": "page",
        "transfer_picture": "method_pictures",
    },
)
