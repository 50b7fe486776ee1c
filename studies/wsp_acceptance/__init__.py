"""Slide protection from very low adhesion up, on several adhesion curves: does one setting serve all of them?"""
