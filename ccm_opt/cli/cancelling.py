"""What happens on Ctrl-C: the command stops, writes ``error: cancelled`` to stderr, and ends with exit code 130.

Where Ctrl-C strikes decides who handles it and what remains on disk:

===================================  ===============================  =================================================
while                                handled in                       what remains
===================================  ===============================  =================================================
modules are loaded                   ``cli.main``, ``CommandGroup``   nothing is written
IPOPT runs in CasADi                 ``ground/ipopt_call.py``         it is kept and raised again, as in the next line
``solve`` plans a problem            ``solving``, ``outcome``         ``solution.json`` with the status ``cancelled``;
                                                                      plans of earlier files stay, later ones are not
                                                                      tried
``solve`` has a verified plan        ``failure_record``               the whole folder, but for pictures and, where it
                                                                      was not waited for, the simulation
``solve`` writes a folder            ``files/export/folder.py``       the whole folder, or none
``pose`` asks for a pose             ``posing``, ``outcome``          ``pose.json`` with the status ``cancelled``
``reach`` looks at cells             ``outcome``                      nothing is written; processes are ended
``compare`` runs its methods         ``comparing``, ``outcome``       every finished run is in the journal, from which
                                                                      the same command goes on; processes are ended
``check``, ``simulate``, ``export``  ``outcome``                      nothing is written
===================================  ===============================  =================================================
"""

import sys

CANCELLED = 130
"""Exit code after Ctrl-C: 128 and the number of the signal, as shells count."""


def report_cancelled() -> int:
    """Report on stderr that the command was cancelled, in plain text since Rich may not be loaded yet.

    Returns:
        The exit code.
    """
    sys.stderr.write("error: cancelled\n")
    return CANCELLED
