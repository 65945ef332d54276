"""What a written page says, and what it refers to."""

from html.parser import HTMLParser

VOID_ELEMENTS = {"meta", "img", "br", "link", "input"}


class Reader(HTMLParser):
    """Checks that elements nest, and gathers what the page refers to and what it says."""

    def __init__(self):
        super().__init__()
        self.open = []
        self.references = []
        self.images = []
        self.headings = []
        self.text = []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.references += [
            attributes[name] for name in ("src", "href", "xlink:href") if name in attributes
        ]
        if tag == "img":
            self.images.append(attributes)
        if tag not in VOID_ELEMENTS:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)
        if "script" not in self.open and "style" not in self.open:
            self.text.append(data)


def read(path):
    reader = Reader()
    reader.feed(path.read_text(encoding="utf-8"))
    assert not reader.open
    return reader
