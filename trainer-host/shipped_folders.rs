// Folders of the repository that a task may need: the program and the Python package carry them.
[
    "assets/airframes",
    "assets/furniture",
    "assets/meshes",
    "assets/movables",
    "assets/pilots",
    "assets/worlds",
    "configs",
]
