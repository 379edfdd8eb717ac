import numpy as np
from numpy.typing import NDArray

def grid(
    costs: NDArray[np.uint8],
    step_costs: NDArray[np.float32],
    start: int,
    goal: int,
    goal_x: float,
    goal_y: float,
    tolerance: float,
    most_iterations: int,
    most_near_goal: int,
    moves: NDArray[np.uint8],
) -> tuple[int, int]: ...
def smooth(
    raw: NDArray[np.float64], path: NDArray[np.float64], data_weight: float, smooth_weight: float
) -> float: ...
def theta(
    costs: NDArray[np.uint8],
    step_costs: NDArray[np.float64],
    sight_costs: NDArray[np.float64],
    start: int,
    goal: int,
    corners: int,
    distance_weight: float,
    heuristic_weight: float,
    parents: NDArray[np.int64],
) -> int: ...
