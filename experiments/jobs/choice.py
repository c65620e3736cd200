"""Where jobs run: on this machine, or on a cluster."""

from orchid_uav.envs.threads import usable_cores
from orchid_uav.experiments.jobs.executor import Executor
from orchid_uav.experiments.jobs.local_processes import LocalProcesses


def executor_for(processes: int | None, ray_address: str | None) -> Executor:
    """The executor that the options ``--jobs`` and ``--ray`` ask for; it wants to be closed.

    Nothing but ``--ray`` joins a cluster, whatever is installed, running or in the environment.

    Args:
        processes: the most jobs at once; None for as many as there are cores.
        ray_address: see ``RayCluster``; None for this machine without Ray.

    Raises:
        InputError: fewer than 1 process, or a cluster that cannot be used.
    """
    if ray_address is None:
        return LocalProcesses(usable_cores() if processes is None else processes)
    from orchid_uav.experiments.jobs.ray_cluster import RayCluster

    return RayCluster(ray_address, processes)
