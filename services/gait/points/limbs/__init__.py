"""Hands and feet: keypoints, surfaces and expectations of limbs."""
