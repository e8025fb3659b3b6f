"""Measured series of quantities, with noise: conversion of units, reading of files, and
residuals."""
