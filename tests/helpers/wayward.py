"""What a student's function may do; in a file of its own, since each process that tries one loads it."""

import os
import time
import warnings


def warns(numbers):
    warnings.warn("look", stacklevel=1)
    return len(numbers)


def changes(numbers):
    numbers[0] = 7
    return 7


def ends(numbers):
    os._exit(3)


def hangs(numbers):
    while True:
        pass


def waits(numbers):
    time.sleep(1e6)


def asks(numbers):
    return input("now? ")
