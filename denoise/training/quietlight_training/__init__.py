"""Nouns of the training: what the verbs `preprocess.py`, `train.py`, `evaluate.py` and `export.py` are made of.

Follow one training example through the modules, in order: `views` finds the rendered views and `exr` reads their layers;
`examples` keeps them as compact arrays and `patches` chooses where to cut; `augment` turns and recolours a patch;
`transforms` and `channels` make network inputs of it; `network` predicts logits, which `kernels` applies to the
radiance; `losses` judges the result; `checkpoint`, `log` and `plots` keep what was learned.

Images are planar, `[channel, row, column]`, row 0 at the top, float32 and linear Rec. 709 unless said otherwise; a batch
puts its axis in front.
"""

import os

# Threads that wait for each other sleep instead of spinning; on a machine that also renders, spinning doubles a step's
# time. Read by OpenMP when torch is imported.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
