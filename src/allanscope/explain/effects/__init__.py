"""explain/effects"""
