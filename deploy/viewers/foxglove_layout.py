"""Layout of Foxglove's app for people4d: image, 3D, latency and processes.

    python -m deploy.viewers.foxglove_layout > deploy/viewers/people4d_layout.json

In the app: Layout, Import from file.
"""

import json
from typing import Any

SHOWN = {"visible": True}


def layout(camera: str) -> str:
    """Return the layout as JSON, for one camera in its image panel."""
    panels = {
        "Image!camera": _image(camera),
        "3D!people": _scene(camera),
        "Plot!latency": _plot("Latency", "/latency.end_to_end_ms", "ms from camera to people"),
        "RawMessages!health": {"topicPath": "/health", "expansion": {}},
    }
    left = {
        "direction": "column",
        "first": "Image!camera",
        "second": "Plot!latency",
        "splitPercentage": 65,
    }
    right = {
        "direction": "column",
        "first": "3D!people",
        "second": "RawMessages!health",
        "splitPercentage": 75,
    }
    arranged = {"direction": "row", "first": left, "second": right, "splitPercentage": 45}
    content = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": arranged,
    }
    return json.dumps(content, indent=2) + "\n"


def _image(camera: str) -> dict[str, Any]:
    return {
        "imageMode": {
            "imageTopic": f"/{camera}/image",
            "calibrationTopic": f"/{camera}/calibration",
            "annotations": {f"/{camera}/annotations": SHOWN},
        },
        "foxglovePanelTitle": f"Camera {camera}",
    }


def _scene(camera: str) -> dict[str, Any]:
    return {
        "followTf": "map",
        "followMode": "follow-none",
        "cameraState": {
            "perspective": True,
            "distance": 9,
            "phi": 55,
            "thetaOffset": 90,
            "targetOffset": [2.5, 0, 0],
            "target": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.1,
            "far": 500,
        },
        "layers": {
            "grid": {
                "layerId": "foxglove.Grid",
                "instanceId": "grid",
                "visible": True,
                "frameId": "map",
                "size": 20,
                "divisions": 20,
            }
        },
        "topics": {
            "/people": SHOWN,
            "/skeletons": SHOWN,
            "/predictions": SHOWN,
            f"/{camera}/calibration": SHOWN,
            f"/{camera}/depth": {
                "visible": True,
                "renderMode": "point cloud",
                "colorMode": "colormap",
                "minValue": 0,
                "maxValue": 6000,
            },
        },
        "foxglovePanelTitle": "People",
    }


def _plot(title: str, path: str, label: str) -> dict[str, Any]:
    return {
        "paths": [
            {"value": path, "enabled": True, "label": label, "timestampMethod": "receiveTime"}
        ],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "followingViewWidth": 30,
        "foxglovePanelTitle": title,
    }


if __name__ == "__main__":
    print(layout("front"), end="")
