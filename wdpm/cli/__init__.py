"""The command line: one file a command."""

from wdpm.generated_code import keep_generated_code

keep_generated_code()
