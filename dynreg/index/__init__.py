"""Nearest neighbours over ids and a distance: a navigable small world, landmarks, Euclidean vectors.

The index never sees a model or a file; brute force is its oracle, and it counts the distances it asks for.
"""

from dynreg.index.construct import build as build
from dynreg.index.construct import build_as_printed as build_as_printed
from dynreg.index.construct import extend as extend
from dynreg.index.distance import Counted as Counted
from dynreg.index.distance import Distance as Distance
from dynreg.index.distance import MatrixDistance as MatrixDistance
from dynreg.index.distance import To as To
from dynreg.index.distance import ToMany as ToMany
from dynreg.index.graph import Graph as Graph
from dynreg.index.graph import GraphSettings as GraphSettings
from dynreg.index.graph import insert as insert
from dynreg.index.landmarks import Landmarks as Landmarks
from dynreg.index.landmarks import build_landmarks as build_landmarks
from dynreg.index.landmarks import extend_landmarks as extend_landmarks
from dynreg.index.landmarks import refine as refine
from dynreg.index.landmarks import search_landmarks as search_landmarks
from dynreg.index.measure import METHODS as METHODS
from dynreg.index.measure import Growth as Growth
from dynreg.index.measure import Hubness as Hubness
from dynreg.index.measure import Row as Row
from dynreg.index.measure import fit_growth as fit_growth
from dynreg.index.measure import hubness as hubness
from dynreg.index.measure import measure_graph as measure_graph
from dynreg.index.measure import nearest_lists as nearest_lists
from dynreg.index.measure import quality as quality
from dynreg.index.measure import recall as recall
from dynreg.index.searches import Found as Found
from dynreg.index.searches import brute_force as brute_force
from dynreg.index.searches import search as search
from dynreg.index.searches import search_many as search_many
from dynreg.index.searches import search_printed as search_printed
from dynreg.index.synthetic import SyntheticEntries as SyntheticEntries
from dynreg.index.vectors import VectorIndex as VectorIndex
from dynreg.index.vectors import vector_index as vector_index
