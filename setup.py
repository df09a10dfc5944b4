"""Maps the top-level folders onto the import name `walkerkit`; metadata is in pyproject.toml."""

from setuptools import find_namespace_packages, setup

FOLDERS = ("actuators", "walkers", "tasks", "gap")

setup(
    packages=[
        f"walkerkit.{package}"
        for folder in FOLDERS
        for package in (folder, *(f"{folder}.{sub}" for sub in find_namespace_packages(folder)))
    ],
    package_dir={f"walkerkit.{folder}": folder for folder in FOLDERS},
    package_data={"": ["py.typed", "assets/**/*"]},
    # Strict editable installs are real links, so that mypy, pyright and editors see them.
    options={"editable_wheel": {"mode": "strict"}},
)
