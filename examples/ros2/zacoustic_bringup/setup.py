"""Installs the package where ament looks: `colcon build --packages-select zacoustic_bringup`."""

from pathlib import Path

from setuptools import setup

NAME = "zacoustic_bringup"
FOLDERS = ("launch", "config", "layouts")


def files(folder: str) -> list[str]:
    """Return the files of a folder, without the folders that Python makes in it."""
    return [str(path) for path in sorted(Path(folder).iterdir()) if path.is_file()]


setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        *((f"share/{NAME}/{folder}", files(folder)) for folder in FOLDERS),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The zacoustic authors",
    maintainer_email="zacoustic@zacoustic.example",
    description="Starts zacoustic's gateway beside ROS 2, and acts when contact is lost.",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"lost_contact = {NAME}.lost_contact:main"]},
)
