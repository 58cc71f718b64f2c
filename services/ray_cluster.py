"""This process as a driver of a Ray cluster: connected while its head answers, and not longer."""

from __future__ import annotations

import logging
import signal
import socket
import threading

import ray

from scene.errors import SceneError

ANSWER_S = 2.0
"""The head answers in milliseconds or is away."""
AWAY_S = 10.0
"""Silence of the head after which it is given up: Ray's own library ends the whole process after
60 s."""


class ClusterAway(SceneError):
    """The cluster does not answer, or this machine is no node of it."""


def connect(address: str) -> bool:
    """Be connected to the cluster whose head is at HOST:PORT; says whether that is new.

    Raises ClusterAway.
    """
    if not answers(address):
        raise ClusterAway(
            f"the head of the Ray cluster must answer at {address}; got no answer; start it "
            "(`ray start --head`), or correct METANERF_RAY_ADDRESS"
        )
    if ray.is_initialized():
        return False
    before = signal.getsignal(signal.SIGTERM)
    try:
        ray.init(address=address, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError) as error:
        raise ClusterAway(
            f"this machine must be a node of the Ray cluster at {address}, with its versions of "
            f"Ray and Python; got: {error}; run this beside the head, or first "
            "`ray start --address` here"
        ) from error
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, before)  # Ray puts its own in its place
    return True


def answers(address: str) -> bool:
    """Whether somebody listens at HOST:PORT; Ray itself would try for minutes."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), ANSWER_S).close()
    except OSError:
        return False
    return True
