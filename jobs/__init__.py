"""Evaluations as work: a request becomes a plan, the plan a graph, the graph is carried out in child processes.

request = jobs.EvaluationRequest(scenes=["cornell-box"], methods=[{"name": "ir"}])
evaluation = jobs.evaluate(jobs.plan(request), folder)
"""

from jobs.errors import RequestError
from jobs.evaluate import Options, evaluate
from jobs.plan import Plan, plan
from jobs.request import EvaluationRequest, MethodRequest

__all__ = ["EvaluationRequest", "MethodRequest", "Options", "Plan", "RequestError", "evaluate", "plan"]
