"""What findings of a recording, a reader or a repaired log say, for tests: codes and numbers."""


def codes(log):
    """Return the codes of what was found."""
    return [one.code for one in log.findings]


def found(log, code):
    """Return the findings of a code."""
    return [one for one in log.findings if one.code == code]


def values_of(log, code):
    """Return the values of the findings of a code."""
    return [one.value for one in found(log, code)]
