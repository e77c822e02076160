#!/usr/bin/env python3
"""The files that man and shells are helped by: bash completes by its own rules what it is asked; every
command and every option of the table is in each of them, and nothing but these.

Usage: help_test.py LPVBAKE
"""

import json
import re
import subprocess
import sys
import unittest

LPVBAKE = sys.argv[1]


def run(*command, **options):
    return subprocess.run(command, capture_output=True, text=True, check=True, **options).stdout


class Help(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.commands = json.loads(run(LPVBAKE, "help", "--format", "json"))["commands"]
        cls.scripts = {form: run(LPVBAKE, "help", "--format", form) for form in ("bash", "zsh", "fish")}

    def complete(self, *words):
        """What bash offers for the last word."""
        line = " ".join(f"'{word}'" for word in words)
        script = (f"{self.scripts['bash']}\ncompopt() {{ :; }}\nCOMP_WORDS=({line}); COMP_CWORD={len(words) - 1}\n"
                  '_lpvbake; printf "%s\\n" "${COMPREPLY[@]}"')
        return run("bash", "-eu", "-c", script).split()

    def names(self, command):
        return {name for option in command["options"] if not option["positional"]
                for name in option["names"].split(",")}

    def test_bash_completes_commands_options_and_choices(self):
        self.assertGreater(len(self.commands), 5)
        self.assertEqual(set(self.complete("lpvbake", "")),
                         {command["name"] for command in self.commands} | {"--help", "--version"})
        self.assertEqual(self.complete("lpvbake", "conv"), ["convert"])
        for command in self.commands:
            self.assertEqual(set(self.complete("lpvbake", command["name"], "-")), self.names(command) | {"--help"})
        self.assertEqual(self.complete("lpvbake", "bake", "--precision", "r"), ["rgb9e5"])
        self.assertEqual(self.complete("lpvbake", "bake", "--output", ""), [])  # bash's own: files

    def test_zsh_and_fish_have_every_option(self):
        for command in self.commands:
            part = re.search(rf"^{command['name']}\)\n(.*?)^    ;;", self.scripts["zsh"], re.M | re.S).group(1)
            self.assertEqual(set(re.findall(r"'\*?(--?[\w-]+)\[", part)), self.names(command) | {"--help"})
            lines = [line for line in self.scripts["fish"].splitlines()
                     if f"__fish_seen_subcommand_from {command['name']}'" in line]
            found = {"--" + name for line in lines for name in re.findall(r" -l ([\w-]+)", line)}
            found |= {"-" + name for line in lines for name in re.findall(r" -s (\w)", line)}
            self.assertEqual(found, self.names(command) | {"--help"})

    def test_pages_are_in_the_macros_of_man(self):
        pages = {"": run(LPVBAKE, "help", "--format", "man")}
        for command in self.commands:
            pages[command["name"]] = run(LPVBAKE, "help", command["name"], "--format", "man")
            for name in self.names(command):
                self.assertIn(name.replace("-", "\\-"), pages[command["name"]])
        for name, page in pages.items():
            self.assertTrue(page.startswith(f'.TH "lpvbake{name and "-" + name}" 1'), name)
            requests = {line.split()[0] for line in page.splitlines() if re.match(r"[.']", line)}
            self.assertLessEqual(requests, {".TH", ".SH", ".TP", ".B", ".BR", ".nf", ".fi"}, name)
            self.assertEqual(page.count(".nf"), page.count(".fi"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
