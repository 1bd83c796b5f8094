"""Shared parts of all services: buses, the process loop, geometry, inference, metrics.

Two libraries send telemetry once imported. Every process of people4d imports this package first,
and passes the variable to its children.
"""

import os
import sys

os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # must be set before onnxruntime is imported
sys.modules["openvino_telemetry"] = None  # type: ignore[assignment]  # OpenVINO has a stub for it
