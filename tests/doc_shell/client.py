"""Substitute for ``ccm-opt`` and ``python`` in the shell of the pages: a client that has a server run the command."""

import array
import json
import os
import signal
import socket
import sys
from pathlib import Path


def main() -> int:
    """Send command line, folder, environment and standard streams to the server; return the command's exit code."""
    program, address, *arguments = sys.argv[1:]
    order = {"words": [program, *arguments], "folder": str(Path.cwd()), "environment": dict(os.environ)}
    with socket.socket(socket.AF_UNIX) as server:
        server.connect(address)
        files = array.array("i", [0, 1, 2])
        server.sendmsg([json.dumps(order).encode()], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, files)])
        with server.makefile() as answers:
            worker = int(answers.readline())
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda received, _: os.kill(worker, received))
            code = int(answers.readline())
    return code if code >= 0 else 128 - code


if __name__ == "__main__":
    sys.exit(main())
