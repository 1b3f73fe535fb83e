#!/bin/bash
# Tries render.sbatch on this machine: two nodes' worth of SLURM daemons, an array of four tasks, one of them killed and put
# back into the queue, the merge, and the same render by one process. Needs slurm-wlm with multiple slurmd (Debian's has
# it), a munged that runs, and root.
#
#     tests/cluster/try.sh FOLDER [QUIETLIGHT]
#
# FOLDER gets everything: configuration, state, logs, pictures.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "${1:?a folder}"/{run/state,pictures}
folder=$(cd "$1" && pwd)
export QUIETLIGHT=${2:-$here/../../target/release/quietlight}
export SLURM_CONF=$folder/run/slurm.conf
export SCENE=$here/../../scenes/cornell-box OUT=$folder/pictures/cornell-box.exr SPP=${SPP:-2048} CHECKPOINT=2s
export OPTIONS="--size 64x64 --integrator ${METHOD:-path} --denoiser none --seed 5"

sed "s#HOST#$(hostname)#g; s#=USER#=$(id -un)#g; s#FOLDER#$folder/run#g" "$here/try.conf" > "$SLURM_CONF"
slurmctld -f "$SLURM_CONF"
sleep 2
for node in one two; do slurmd -f "$SLURM_CONF" -N "$node"; done
trap 'for pid in "$folder"/run/*.pid; do kill "$(cat "$pid")"; done' EXIT
sleep 2
sinfo --Node --long

cd "$folder/pictures"
job=$(sbatch --parsable --array=0-3 "$here/render.sbatch")
echo "job $job of four tasks"
# Until the second task has kept something.
for _ in $(seq 120); do
    [ -e cornell-box.1-of-4.checkpoint ] && break
    sleep 0.5
done
squeue
ls -l cornell-box.*checkpoint
# By the system, not by `scancel`, which asks before it kills.
kill -KILL "$(pgrep --full -- "-o $OUT .*--shard 1/4")"
for _ in $(seq 60); do
    state=$(scontrol show job "${job}_1" | grep -o 'JobState=[A-Z]*')
    [ "$state" != JobState=RUNNING ] && [ "$state" != JobState=COMPLETING ] && break
    sleep 0.5
done
echo "task 1 was killed: $state"
# It waits two minutes before it starts again.
scontrol requeue "${job}_1"
while [ -n "$(squeue --noheader --job "$job" 2>/dev/null)" ]; do sleep 1; done
scontrol show job "$job" | grep -E 'ArrayTaskId|JobState|Restarts|RunTime|NodeList=[a-z]' || true
ls -l ./*.shard

"$QUIETLIGHT" merge cornell-box.exr cornell-box.*.shard --denoiser none
# shellcheck disable=SC2086
"$QUIETLIGHT" render "$SCENE" -o whole.exr --spp "$SPP" $OPTIONS
"$QUIETLIGHT" compare cornell-box.exr whole.exr
