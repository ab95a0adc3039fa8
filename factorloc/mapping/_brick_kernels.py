"""Kernels on cells sorted by key: gathered from pools of bricks, and merged."""

from factorloc._jit import exact_kernel
from factorloc.mapping._traversal_kernels import MISS_BITS


@exact_kernel(allocates=False)
def count_visited(walked, hits, counts):
    """Count the cells of each brick that some ray left anything in.

    Parameters
    ----------
    walked, hits : (B + 1, cells) int64 and uint32
        As the walk leaves them; the first brick is spare.
    counts : (B,) int64
        Written.
    """
    for b in range(counts.shape[0]):
        count = 0
        for cell in range(walked.shape[1]):
            if walked[b + 1, cell] != 0 or hits[b + 1, cell] != 0:
                count += 1
        counts[b] = count


@exact_kernel(allocates=False)
def gather_visited(walked, hits, offsets, locals_out, hits_out, misses_out, path_out):
    """Write the visited cells of each brick one after the other, from ``offsets`` (B + 1,) on."""
    for b in range(offsets.shape[0] - 1):
        to = offsets[b]
        for cell in range(walked.shape[1]):
            value = walked[b + 1, cell]
            if value != 0 or hits[b + 1, cell] != 0:
                locals_out[to] = cell
                hits_out[to] = hits[b + 1, cell]
                misses_out[to] = value & (2**MISS_BITS - 1)
                path_out[to] = value >> MISS_BITS
                to += 1


@exact_kernel(allocates=False)
def merge_sorted(keys_a, keys_b, from_a, from_b):
    """Merge two increasing lists of keys; equal ones become one.

    Parameters
    ----------
    keys_a, keys_b : (N,), (M,) int64
        Strictly increasing.
    from_a, from_b : (N,), (M,) int64
        Written: place of each key in the merged list.

    Returns
    -------
    int
        Length of the merged list.
    """
    a = 0
    b = 0
    place = 0
    while a < keys_a.shape[0] or b < keys_b.shape[0]:
        take_a = b == keys_b.shape[0] or (a < keys_a.shape[0] and keys_a[a] <= keys_b[b])
        take_b = a == keys_a.shape[0] or (b < keys_b.shape[0] and keys_b[b] <= keys_a[a])
        if take_a:
            from_a[a] = place
            a += 1
        if take_b:
            from_b[b] = place
            b += 1
        place += 1
    return place
