#!/bin/bash
#SBATCH --job-name=lpvbake --requeue --open-mode=append --nodes=1 --ntasks=1
# Bakes ROWS rows of a world's plan in each task of a Slurm array, and checks the whole after it:
#
#   plan=city.world.json                     # of lpvbake world city.glb -o city.world.json ...
#   array=$(sbatch --parsable --array=0-99 --cpus-per-task=4 --mem=2G \
#       --export=ALL,PLAN=$plan,ROWS=10 rows.sh)
#   check=$(sbatch --parsable --dependency=afterok:$array --export=ALL,PLAN=$plan check.sh)
#   sbatch --dependency=afterok:$check \
#       --export=ALL,PLAN=$plan,SCENARIO=noon,VOLUME=noon.vdb export.sh    # if one volume is wanted
#
# lpvbake world's plan tells how many rows there are; its dry-run of a row tells time and memory.
# Submit the same lines again after a failure: rows that are there are left as they are.
#
# A task that may go better another time goes back into the queue by itself while it still runs: one
# that ended with an error, and be it requeued later, never lets --dependency=afterok of its array
# start.
first=$((SLURM_ARRAY_TASK_ID * ROWS))
"${LPVBAKE:-lpvbake}" world "$PLAN" --rows "$first-$((first + ROWS - 1))" &
bake=$!
trap 'kill -TERM $bake 2>/dev/null' TERM
wait $bake
code=$?
case $code in # see the table of lpvbake help: what is worth another try
2 | 6 | 8 | 137 | 143)
    if [[ ${SLURM_RESTART_COUNT:-0} -lt 3 ]]; then
        echo "ended with $code, again"
        scontrol requeue "${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID" && sleep 60
    fi
    ;;
esac
exit $code
