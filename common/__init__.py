"""Shared parts of all services: buses, the process loop, geometry, inference, metrics.

Two libraries send telemetry from their import on. Every process of people4d imports this package
before them and passes the variable to its children.
"""

import os
import sys

os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # after the import of onnxruntime it is too late
sys.modules["openvino_telemetry"] = None  # type: ignore[assignment]  # OpenVINO has a stub for it
