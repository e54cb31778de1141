"""Policies that carry over: they score the elements of a product, however many there are.

An element is a component of the product that has to be brought to its goal, such as a part or a
screw. What is known of elements and of pairs of them is worked out here, and so are the scores;
who learns them is a plugin's matter.
"""
