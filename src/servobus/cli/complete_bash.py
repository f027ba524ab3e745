"""The Tab key in bash, which takes `virtual:rx28@1` and `led=on` for several words.

Bash breaks words at colons and equals signs (COMP_WORDBREAKS) and replaces only what stands behind the last of them. So
the words are put together again here, and what is offered is cut where bash goes on.
"""

import os

from click.shell_completion import BashComplete, CompletionItem, add_completion_class, split_arg_string

BREAKS = frozenset(":=")


class WholeWords(BashComplete):
    """Click's completion for bash, with words as they were typed, and without a space behind `REGISTER=`."""

    source_template = BashComplete.source_template.replace(
        "    return 0\n", "    [[ ${COMPREPLY[0]} == *= ]] && compopt -o nospace\n    return 0\n"
    )
    _kept = ""
    """What of the last word bash leaves as it is."""

    def get_completion_args(self) -> tuple[list[str], str]:
        broken, at = split_arg_string(os.environ["COMP_WORDS"]), int(os.environ["COMP_CWORD"])
        words: list[str] = []
        goes_on = False
        for word in broken[1 : at + 1]:
            breaks = BREAKS.issuperset(word)
            if words and (goes_on or breaks):
                words[-1] += word
            else:
                words.append(word)
            goes_on = breaks
        incomplete = words.pop() if at < len(broken) else ""
        self._kept = incomplete[: 1 + max(map(incomplete.rfind, BREAKS))]
        return words, incomplete

    def format_completion(self, item: CompletionItem) -> str:
        return f"{item.type},{item.value.removeprefix(self._kept)}"


add_completion_class(WholeWords)
