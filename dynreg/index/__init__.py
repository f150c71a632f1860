"""Nearest neighbours over ids and a distance: a navigable small world, Euclidean vectors.

The index never sees a model or a file; brute force is its oracle, and it counts the distances it asks for.
"""

from dynreg.index.construct import build as build
from dynreg.index.construct import extend as extend
from dynreg.index.construct import insert as insert
from dynreg.index.distance import Counted as Counted
from dynreg.index.distance import Distance as Distance
from dynreg.index.distance import To as To
from dynreg.index.distance import ToMany as ToMany
from dynreg.index.graph import NO_CAP as NO_CAP
from dynreg.index.graph import Graph as Graph
from dynreg.index.graph import GraphSettings as GraphSettings
from dynreg.index.searches import Found as Found
from dynreg.index.searches import brute_force as brute_force
from dynreg.index.searches import search as search
from dynreg.index.searches import search_many as search_many
from dynreg.index.searches import search_printed as search_printed
from dynreg.index.vectors import vector_index as vector_index
