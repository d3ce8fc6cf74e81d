"""allan"""
