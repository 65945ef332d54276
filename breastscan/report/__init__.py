"""What a run folder shows to people: the HTML page, the terminal summary, the comparison with
the paper.
"""

from breastscan.report.page import write as write
from breastscan.report.paper import compare_table4 as compare_table4
from breastscan.report.terminal import summary as summary
