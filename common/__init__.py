"""Shared nouns and seams: messages, topics, buses, the process loop, geometry, inference.

Two libraries send telemetry once they are imported. Every process of people4d imports this package
before them and passes the variable on to its children.
"""

import os
import sys

os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # a call after the import of onnxruntime is too late
sys.modules["openvino_telemetry"] = None  # type: ignore[assignment]  # OpenVINO has a stub for it
