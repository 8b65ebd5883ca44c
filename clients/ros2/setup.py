"""ament_python package: `colcon build`, then `ros2 run cogrip_ros2 hold LINK`."""

from setuptools import setup

setup(
    name="cogrip_ros2",
    version="0.1.0",
    packages=["cogrip_ros2"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/cogrip_ros2"]),
        ("share/cogrip_ros2", ["package.xml"]),
    ],
    install_requires=["setuptools", "cogrip"],
    entry_points={"console_scripts": ["hold = cogrip_ros2.hold:main", "watch = cogrip_ros2.watch:main"]},
)
