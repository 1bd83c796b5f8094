"""Tests of people4d."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"
DEMO = ROOT / "deploy" / "demo" / "crossing.mcap"
