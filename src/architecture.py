#!/usr/bin/env python3
"""Draws src/architecture.svg: the rooms of src/, and what flows from one to the next.

Usage: architecture.py [--check]     --check writes nothing, and exits 1 if the picture is stale

Arrows are the DEPENDS of the lpvbake_folder() lines in CMakeLists.txt, turned around: from a room to
those that build on it. One that others imply is left out. Colours and second lines are columns of the
table of rooms in src/README.md.

Boxes stand in layers as Sugiyama, Tagawa and Toda 1981 have it: layers that keep arrows short, bends
where an arrow passes a layer, orders with few crossings, then places that keep arrows straight.
"""

import pathlib
import re
import sys
from html import escape

ROOT = pathlib.Path(__file__).resolve().parent.parent
PICTURE = "src/architecture.svg"

BOX, BEND = 128, 18  # widths, pixels
HEIGHT, FLOOR, GAP, MARGIN = 40, 92, 22, 20
COLOURS = {  # part of the table -> fill, edge, what the legend says
    "scene": ("#dbe9f9", "#3f6ea3", "scene"),
    "light": ("#fdebc8", "#b07a17", "light"),
    "field": ("#dcf0dc", "#3f8449", "field"),
    "device": ("#e7e7ea", "#6d6d78", "device"),
    "truth": ("#efdff3", "#85509a", "truth and pictures"),
    "driver": ("#f9dcd8", "#ad4a3d", "driver"),
}


def folders(root):
    """Folder of src/ -> the folders that it builds on, as CMakeLists.txt has them."""
    text = (root / "CMakeLists.txt").read_text(encoding="utf-8")
    headers = [name for name in re.findall(r"^add_library\(lpvbake_(\w+) INTERFACE\)", text, re.M)
               if (root / "src" / name).is_dir()]  # folders without a .cpp
    table, names = {name: [] for name in headers}, {name: name for name in headers}
    for call in re.findall(r"^lpvbake_folder\(([^)]*)\)", text, re.M):
        folder, *rest = call.split()
        names[folder.replace("/", "_")] = folder
        depends = rest[1:] if rest[:1] == ["DEPENDS"] else []
        if "LIBRARIES" in depends:
            depends = depends[:depends.index("LIBRARIES")]
        table[folder] = [names[d] for d in depends]  # KeyError: not to the left of it
    return table


def program(root, rooms):
    """What the program itself links."""
    call = re.search(r"^target_link_libraries\(lpvbake PRIVATE ([^)]*)\)",
                     (root / "CMakeLists.txt").read_text(encoding="utf-8"), re.M).group(1).split()
    return [room for room in rooms if "lpvbake_" + room.replace("/", "_") in call]


def described(root):
    """Room -> its part and what it hands on, from src/README.md."""
    rows = re.findall(r"^\| \[?`([\w/]+)/`(?:\]\([^)]*\))? \| (\w+) \| [^|]* \| ([^|]*) \|$",
                      (root / "src/README.md").read_text(encoding="utf-8"), re.M)
    return {room: (part, hands_on.replace("`", "").strip()) for room, part, hands_on in rows}


def without_implied(table):
    """The table less what follows from the rest of it."""
    below = {}
    for room, depends in table.items():  # what a room builds on stands before it
        below[room] = set(depends).union(*(below[d] for d in depends))
    return {room: [d for d in dict.fromkeys(depends)
                   if not any(d in below[other] for other in depends if other != d)]
            for room, depends in table.items()}


def layers_of(table):
    """Room -> layer, below all that it builds on; moved down where that shortens arrows."""
    users = {room: [u for u in table if room in table[u]] for room in table}
    layer = {}
    for room in table:
        layer[room] = 1 + max((layer[d] for d in table[room]), default=-1)
    for room in reversed(list(table)):
        if users[room] and len(users[room]) >= len(table[room]):
            layer[room] = min(layer[u] for u in users[room]) - 1
    return layer


class Graph:
    """Rooms and bends, each in a layer; every link goes from one layer to the next."""

    def __init__(self, table):
        layer = layers_of(table)
        self.rows = [[] for _ in range(max(layer.values()) + 1)]
        self.up, self.down = {}, {}
        self.arrows = []  # the nodes along each
        for room in table:
            self.add(room, layer[room])
        for room, depends in table.items():
            for d in depends:
                way = [d]
                for level in range(layer[d] + 1, layer[room]):
                    bend = (d, room, level)
                    self.add(bend, level)
                    way.append(bend)
                way.append(room)
                self.arrows.append(way)
                for a, b in zip(way, way[1:]):
                    self.down[a].append(b)
                    self.up[b].append(a)

    def add(self, node, level):
        self.rows[level].append(node)
        self.up[node], self.down[node] = [], []

    def crossings(self):
        total = 0
        for upper, lower in zip(self.rows, self.rows[1:]):
            place = {node: i for i, node in enumerate(lower)}
            links = [place[d] for node in upper for d in sorted(self.down[node], key=place.get)]
            total += sum(a > b for i, a in enumerate(links) for b in links[i + 1:])
        return total

    def order(self):
        """Few crossings: rows sorted by the mean place of neighbours, then neighbours swapped."""
        best, least = [list(row) for row in self.rows], self.crossings()
        for sweep in range(24):
            near = self.up if sweep % 2 == 0 else self.down
            rows = self.rows if sweep % 2 == 0 else self.rows[::-1]
            for before, row in zip(rows, rows[1:]):
                place = {node: i for i, node in enumerate(before)}
                own = {node: i for i, node in enumerate(row)}
                row.sort(key=lambda n: (sum(place[m] for m in near[n]) / len(near[n])
                                        if near[n] else own[n]))
            self.swap()
            if self.crossings() < least:
                best, least = [list(row) for row in self.rows], self.crossings()
        self.rows = best

    def swap(self):
        found = True
        while found:
            found = False
            for row in self.rows:
                for i in range(len(row) - 1):
                    before = self.crossings()
                    row[i], row[i + 1] = row[i + 1], row[i]
                    if self.crossings() < before:
                        found = True
                    else:
                        row[i], row[i + 1] = row[i + 1], row[i]

    def place(self):
        """Node -> x of its middle: near the mean of its neighbours, bends before all, none too close."""
        def width(node):
            return BOX if isinstance(node, str) else BEND

        def apart(a, b):
            return (width(a) + width(b)) / 2 + GAP

        def stiffness(a, b):  # of the link between them: the longer the arrow, the straighter
            return (1, 4, 16)[2 - isinstance(a, str) - isinstance(b, str)]

        x = {}
        for row in self.rows:
            at = 0.0
            for before, node in zip([None] + row, row):
                at += apart(before, node) if before is not None else 0.0
                x[node] = at
            for node in row:
                x[node] -= at / 2
        for sweep in range(200):
            for row in self.rows if sweep % 2 == 0 else self.rows[::-1]:
                wish = []
                for node in row:
                    near = self.up[node] + self.down[node]
                    weights = [stiffness(node, m) for m in near]
                    wish.append(sum(w * x[m] for w, m in zip(weights, near)) / sum(weights))
                # The nearest places that keep distances: blocks of nodes that touch move as one.
                offset, blocks = 0.0, []
                for i, node in enumerate(row):
                    offset += apart(row[i - 1], node) if i else 0.0
                    weight = sum(stiffness(node, m) for m in self.up[node] + self.down[node])
                    blocks.append([weight * (wish[i] - offset), weight, [(node, offset)]])
                    while len(blocks) > 1 and (blocks[-2][0] * blocks[-1][1]
                                               > blocks[-1][0] * blocks[-2][1]):
                        last = blocks.pop()
                        blocks[-1] = [a + b for a, b in zip(blocks[-1], last)]
                for total, weight, nodes in blocks:
                    for node, at in nodes:
                        x[node] = total / weight + at
        return x


def svg(root):
    table = folders(root)
    table["cmd"] = program(root, table)
    about = described(root)
    if lacking := [room for room in table if room not in about]:
        sys.exit("src/README.md: the table of rooms has no row of " + ", ".join(lacking))
    if surplus := [room for room in about if room not in table]:
        sys.exit("src/README.md: no such room: " + ", ".join(surplus))

    graph = Graph(without_implied(table))
    graph.order()
    x = graph.place()
    left = min(x[room] for room in table) - BOX / 2 - MARGIN
    left = min([left] + [v - MARGIN for v in x.values()])
    width = max([x[room] + BOX / 2 for room in table] + list(x.values())) + MARGIN - left
    y = {node: MARGIN + FLOOR * level for level, row in enumerate(graph.rows) for node in row}
    height = MARGIN * 2 + FLOOR * (len(graph.rows) - 1) + HEIGHT

    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height}" '
           f'viewBox="0 0 {width:.0f} {height}" font-family="Helvetica, Arial, sans-serif">',
           '<title>The rooms of src/ and what flows between them</title>',
           '<rect width="100%" height="100%" fill="#fff"/>',
           '<defs><marker id="head" viewBox="0 0 8 8" refX="7.5" refY="4" markerWidth="7" '
           'markerHeight="7" orient="auto"><path d="M0 .5 8 4 0 7.5z" fill="#5d6470"/></marker></defs>',
           '<g fill="none" stroke="#5d6470" stroke-width="1.3">']

    def ends(node, others):
        """Where a box's arrows touch it: side by side, in the order of where they go."""
        ordered = sorted(others, key=lambda m: x[m])
        step = min(16.0, (BOX - 32) / max(1, len(ordered) - 1))
        return {m: x[node] + (i - (len(ordered) - 1) / 2) * step for i, m in enumerate(ordered)}

    leave = {room: ends(room, graph.down[room]) for room in table}
    arrive = {room: ends(room, graph.up[room]) for room in table}
    for way in graph.arrows:
        points = [(leave[way[0]][way[1]], y[way[0]] + HEIGHT)]
        for bend in way[1:-1]:  # straight down beside the boxes of its layer
            points += [(x[bend], y[bend]), (x[bend], y[bend] + HEIGHT)]
        points.append((arrive[way[-1]][way[-2]], y[way[-1]]))
        points = [(a - left, b) for a, b in points]
        path = f"M{points[0][0]:.1f} {points[0][1]}"
        for i, ((x0, y0), (x1, y1)) in enumerate(zip(points, points[1:])):
            if i % 2 == 1:
                path += f" V{y1}"
            else:
                middle = (y0 + y1) / 2
                path += f" C{x0:.1f} {middle:g} {x1:.1f} {middle:g} {x1:.1f} {y1}"
        out.append(f'<path d="{path}" marker-end="url(#head)"/>')
    out.append("</g>")

    for room in table:
        part, hands_on = about[room]
        fill, edge, _ = COLOURS[part]
        at = x[room] - left
        out.append(f'<rect x="{at - BOX / 2:.1f}" y="{y[room]}" width="{BOX}" height="{HEIGHT}" rx="6" '
                   f'fill="{fill}" stroke="{edge}" stroke-width="1.3"/>')
        name = f'<text x="{at:.1f}" y="{{}}" text-anchor="middle" font-size="{{}}" fill="{{}}">{{}}</text>'
        out.append(name.format(y[room] + 17, 14, "#1c2230", f"<tspan font-weight='bold'>{escape(room)}</tspan>"))
        out.append(name.format(y[room] + 32, 11, "#444c5c", escape(hands_on)))

    top = height - MARGIN - 20 * len(COLOURS)
    for i, (fill, edge, text) in enumerate(COLOURS.values()):
        out.append(f'<rect x="{MARGIN}" y="{top + 20 * i}" width="18" height="13" rx="3" fill="{fill}" '
                   f'stroke="{edge}"/>')
        out.append(f'<text x="{MARGIN + 26}" y="{top + 20 * i + 11}" font-size="12" fill="#1c2230">{text}</text>')
    return "\n".join(out + ["</svg>", ""])


def main():
    picture, file = svg(ROOT), ROOT / PICTURE
    if sys.argv[1:] == ["--check"]:
        if not file.exists() or file.read_text(encoding="utf-8") != picture:
            sys.exit(f"{PICTURE} is stale: run src/architecture.py")
    else:
        file.write_text(picture, encoding="utf-8")


if __name__ == "__main__":
    main()
