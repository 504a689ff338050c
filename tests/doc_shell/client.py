"""Stands for ``ccm-opt`` or ``python`` in the shell of the pages: hands the command to the server, ends as it ends."""

import array
import json
import os
import signal
import socket
import sys
from pathlib import Path


def main() -> int:
    """Hand over the command line, the folder, the environment and the three files."""
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
