"""Residuals of the equations of motion and of the chambers along a measured motion.

`residuals.py`: of shaft and chambers through the model's ports; `motion.py`: the one filter, and
which samples count; `samples.py`: the effort balance as rows of a regression; `imposed.py`: a
recording's motion imposed on a model; `momentum.py`: the balance over an interval, in weak form.
"""
