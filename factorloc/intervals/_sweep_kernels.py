"""Sweeps over the bounds of many intervals."""

import math

import numpy as np

from factorloc._jit import exact_kernel

FEW = 64


@exact_kernel
def sort_first(values, count):
    """Sort the first ``count`` values in place: by insertion where they are few, which is faster then."""
    if count > FEW:
        values[:count] = np.sort(values[:count])
        return
    for m in range(1, count):
        value = values[m]
        k = m
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value


@exact_kernel
def relax(lo, hi, least, starts, ends, out_lo, out_hi):
    """Hulls of what at least ``least`` of K intervals share, (K, N) to (N,); ``starts, ends`` are (K,) to work in.

    The set of such numbers is a union of closed intervals: its first number is a lower bound, its last an upper one. At
    the m-th lower bound in order, m intervals have begun; those that ended before it are those with smaller ends.
    """
    for i in range(lo.shape[1]):
        count = 0
        for k in range(lo.shape[0]):
            if lo[k, i] == lo[k, i]:
                starts[count], ends[count] = lo[k, i], hi[k, i]
                count += 1
        out_lo[i], out_hi[i] = math.nan, math.nan
        if count < least:
            continue
        sort_first(starts, count)
        sort_first(ends, count)
        gone = 0
        for m in range(count):
            while ends[gone] < starts[m]:
                gone += 1
            if m + 1 - gone >= least:
                out_lo[i] = starts[m]
                break
        gone = 0
        for m in range(count):
            while starts[count - 1 - gone] > ends[count - 1 - m]:
                gone += 1
            if m + 1 - gone >= least:
                out_hi[i] = ends[count - 1 - m]
                break
