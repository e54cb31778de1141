"""Recognise kinds of parts by their names, in several languages and by standards.

Source of the standards: DIN, ISO, GB/T and JIS catalogues of fasteners.
"""

from __future__ import annotations

import re
import unicodedata
from functools import cache

from skillplan_cad.reading.names import says_nothing
from skillplan_cad.relation import PartKind

# Standards of each kind: DIN, ISO, GB.
_STANDARDS: dict[PartKind, tuple[str, str, str]] = {
    "washer": (
        "125 126 127 128 137 433 434 435 436 440 6319 6340 6796 6797 6798 6902 6905 6907 7349 "
        "7980 9021",
        "7089 7090 7091 7092 7093 7094 10669 10673",
        "93 95 96 97 848 849 859 860 861 862",
    ),
    "nut": (
        "431 439 466 467 508 546 547 548 555 557 562 582 917 928 929 934 935 936 970 971 980 981 "
        "982 985 986 1587 1624 6330 6331 6334 6915 6923 6924 6925 6926 6927 7967",
        "4032 4033 4034 4035 4036 4161 7040 7041 7042 7043 7044 7719 7720 10511 10512 10513 8673 "
        "8674 8675",
        "41 56 62 923 6170 6171 6172 6173 6175 6177 889",
    ),
    "pin": (
        "1 7 94 1433 1434 1443 1444 1471 1472 1473 1474 1475 1476 1481 6325 7343 7344 7346 7977 "
        "7978 7979 660 661 662 7337 7338",
        "1234 2338 2339 2340 2341 8733 8734 8735 8736 8737 8739 8740 8741 8742 8743 8744 8745 "
        "8746 8747 8748 8750 8752 13337 15973 15977",
        "91 117 119 120 879 882 867 869",
    ),
    "screw": (
        "84 85 186 188 261 316 404 417 427 438 444 464 478 479 480 529 551 553 571 580 603 604 605 "
        "607 608 609 610 653 835 907 912 913 914 915 916 920 921 922 923 924 925 926 927 931 933 "
        "938 939 940 960 961 963 964 965 966 968 975 976 6900 6912 6914 6921 7500 7504 7513 7516 "
        "7968 7969 7971 7972 7973 7976 7981 7982 7983 7984 7985 7990 7991 7995 7996 7997 7999",
        "1207 1479 1481 1482 1580 2009 2010 4014 4016 4017 4018 4026 4027 4028 4029 4762 7045 7046 "
        "7047 7048 7049 7050 7051 7378 7379 7380 7434 7435 7436 8676 8765 10642 12474 13918 14579 "
        "14580 14581 14583 14584 14586 14587 15071 15480 15481 15482 15483 21269",
        "65 67 68 69 70 71 73 77 78 80 818 819 820 823 845 846 847 5780 5781 5782 5783 5785 5786",
    ),
}  # fmt: skip
# Words of each kind; those of Romance languages come before what they hold: "vis de montage".
_WORDS: dict[PartKind, tuple[str, str]] = {
    "washer": (
        r"[a-z]*washers?|u ?scheiben?|(unterleg|feder|sicherungs|facher|zahn|spann|beilag|anlauf)"
        r"scheiben?|scheiben?|federring|sluitring|bricka|podkladka|podlozka|шайб[аы]|pullar",
        r"rondelles?|rondell[ae]|arandelas?|arruelas?",
    ),
    "nut": (
        r"(hex|lock|wing|cap|square|flange|jam|nyloc)?nuts?|[a-z]*muttern?|moer(en)?|nakretka|"
        r"matice|mutrar?|гаик[аи]|somun",
        r"ecrous?|tuercas?|porcas?|dad[oi]",
    ),
    "pin": (
        r"dowell?s?|dowell?pins?|[a-z]*stifte?|[a-z]*bolzen|(crank|wrist|clevis|king|roll|cotter|"
        r"taper|spring|split|hinge|pivot)?pins?|rivets?|(blind)?niete?n?|kolek|kolik|штифт|"
        r"заклепк[аи]",
        r"goupilles?|rivets?|pasador(es)?|remaches?|spin[ae]|rivett[oi]|pinos?|rebites?",
    ),
    "screw": (
        r"[a-z]*screws?|[a-z]*bolts?|[bfs]hcs|[a-z]*schrauben?|schroe(f|ven)|bout(en)?|skruv(ar)?|"
        r"srub[ay]?|srouby?|винт|болт|vida|civata|socket (head )?cap|hex(agon)? head|cap head|"
        r"button head|pan head|countersunk",
        r"vis|boulons?|tornillos?|parafusos?|vit[ei]|bullon[ei]",
    ),
}  # fmt: skip
_SIGNS: dict[PartKind, str] = {
    "washer": "垫圈|垫片|墊圈|ワッシャ|座金|와셔",
    "nut": "螺母|螺帽|ナット|너트",
    "pin": "销钉|销|銷|铆钉|鉚釘|ピン|リベット|리벳",
    "screw": "螺丝|螺絲|螺钉|螺釘|螺栓|ネジ|ねじ|ボルト|나사|볼트",
}
# A size such as M3x8; other words decide what has it.
_SIZE = r"m\d+(\.\d+)?( ?[x*\u00d7] ?\d+(\.\d+)?)+"
# Machine elements and tools that the words of fasteners name, too.
_MACHINE = re.compile(
    r"(lead|ball|power|feed|jack|trapez\w*|archimedes|extruder|conveyor) ?(screws?|nuts?)|"
    r"screw ?drivers?|(kugel|gewinde|trapez)\w*(spindel|mutter)|schraubendreher|"
    r"bolt ?action|dead ?bolts?|nut ?runner|rolling ?pin|vis[ -](mere|sans fin)|"
    r"pin ?(headers?|sockets?|out)"
)
# Nouns after a fastener's name that make it a modifier: "nut holder".
_HOLDER = (
    r"(holders?|hold|mounts?|mounting plate|plates?|blocks?|brackets?|covers?|caps?|plugs?|holes?|"
    r"traps?|guides?|spacers?|stand ?offs?|sleeves?|bush(ing)?s?|inserts?|bearings?|tools?|heads?|"
    r"sockets?|terminals?|headers?|connectors?|housings?|gears?|wheels?|supports?|carriers?|arms?|"
    r"joints?|adapters?|boxe?s?|cases?|pulleys?|clamps?|seats?|rails?|motors?|jigs?|trays?|"
    r"halter|halterung|platte|block|deckel|abdeckung|buchse|hulse|kappe|lager|aufnahme|座|板|盖|套)"
)
_CARRIER = r"(support|plaque|carter|boitier|entretoise|soporte|placa|supporto|piastra)s?"
_APART = re.compile(
    r"(?<![a-z])(inserts?|einsatz|stand ?offs?|spacers?|distanz\w*|entretoises?|bush(ing)?s?|"
    r"buchse|hulse|sleeves?|taps?|drills?)(?![a-z])"
)
_SEAL = re.compile(
    r"(?<![a-z])(o[ _-]?rings?|seals?|gaskets?|dichtung(en|sring)?|simmerring|packing|"
    r"joint torique|guarnizion[ei]|junta torica|密封圈|oリング)(?![a-z])"
)
_GEAR = re.compile(
    r"(?<![a-z])([a-z]*gears?|pinions?|sprockets?|gear ?wheels?|zahnrader|[a-z]*zahnrad|ritzel|"
    r"engrenages?|pignons?|engranajes?|pinon(es)?|ingranaggi?o?|ruota dentata|tandwiel(en)?|"
    r"шестерн[яи]|齿轮|歯車|기어)(?![a-z])"
)
# Machine elements that have heads and tapped ends like screws.
_LONG = re.compile(
    r"(?<![a-z])(rods?|shafts?|axles?|spindles?|pipes?|tubes?|levers?|handles?|[a-z]*stangen?|"
    r"[a-z]*wellen?|achsen?|rohre?|hebel|tiges?|arbres?|ejes?|varillas?|вал|轴|軸)(?![a-z])"
)


def recognise_kind(name: str, design: str) -> PartKind | None:
    """Return the kind that a part's own name or its design's name implies, or None.

    Parameters
    ----------
    name
        Path of the part; a last word without meaning, such as ``SOLID``, gives way to the one
        above.
    """
    levels = name.split("/")
    own = next((level for level in reversed(levels) if not says_nothing(level)), levels[-1])
    for text in (own, design):
        kind = _recognise_text(text)
        if kind is not None:
            return kind
    return None


def is_seal_name(name: str) -> bool:
    """Return whether a name is that of an O-ring or gasket, which is squeezed."""
    return _SEAL.search(_normalise(name)) is not None


def is_gear_name(name: str, design: str) -> bool:
    """Return whether a part is named like a gear; not if only an assembly above it is."""
    return any(_GEAR.search(_normalise(text)) for text in (name.split("/")[-1], design))


def is_rod_name(name: str, design: str) -> bool:
    """Return whether a part is named like a rod, shaft or lever, not after an assembly above it."""
    return any(_LONG.search(_normalise(text)) for text in (name.split("/")[-1], design))


@cache
def _recognise_text(text: str) -> PartKind | None:
    # SolidWorks writes "SUBASSEMBLY-1 PART-1"; sizes and grades belong to the word before them, as
    # in "ISO 7046-1 - M4 x 20 - 4.8 - Z".
    pieces = re.split(r"(?<=-\d) (?=\S)|(?<=-\d\d) (?=\S)| - ", text)
    worded = [place for place, piece in enumerate(pieces) if re.search(r"[^\W\d_]{3}", piece)]
    own = " ".join(pieces[worded[-1] if worded else 0 :])
    words = _normalise(own)
    if _MACHINE.search(words):
        return None
    for kind, (pattern, romance) in _WORDS.items():
        if _has_standard(words, kind):
            return kind
        if re.search(_SIGNS[kind], own) and not re.search(rf"({_SIGNS[kind]}).*{_HOLDER}", own):
            return kind
        for match in re.finditer(
            rf"(?<![a-z\u0430-\u044f])({pattern})(?![a-z\u0430-\u044f]| in )", words
        ):
            if not re.match(rf" {_HOLDER}(?![a-z])", words[match.end() :]):
                return kind
        for match in re.finditer(rf"(?<![a-z])({romance})(?![a-z])", words):
            if not re.search(rf"(?<![a-z]){_CARRIER}(?![a-z])", words[: match.start()]):
                return kind
    if re.search(rf"(?<![a-z0-9]){_SIZE}(?![a-z])", words) and not _APART.search(words):
        return "screw"
    return None


def _has_standard(words: str, kind: PartKind) -> bool:
    families = zip(("din( en)?", "(din )?(en )?iso", r"gb ?/? ?t?"), _STANDARDS[kind], strict=True)
    return any(
        re.search(rf"(?<![a-z]){family} ?({'|'.join(numbers.split())})(?!\d)", words)
        for family, numbers in families
    )


def _normalise(text: str) -> str:
    """Return a text in lower case, without accents, with words apart."""
    apart = re.sub(r"([a-z])([A-Z])", r"\1 \2", text.replace("ß", "ss"))
    apart = re.sub(r"([0-9])(?=[A-Za-z]{3})", r"\1 ", apart)
    apart = re.sub(r"[_\-/,;]+", " ", apart).replace("ł", "l").replace("Ł", "L")
    plain = unicodedata.normalize("NFKD", apart.lower())
    kept = "".join(sign for sign in plain if not unicodedata.combining(sign) or sign > "\u3000")
    return " ".join(unicodedata.normalize("NFC", kept).split())
