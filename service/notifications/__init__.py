"""Telling others: messages written with the change that they report, sent by webhook and by mail."""
