#!/bin/bash
#SBATCH --job-name=lpvbake-check --nodes=1 --ntasks=1
# Names the rows of a plan that are missing, damaged or of something else, and measures the seams.
exec "${LPVBAKE:-lpvbake}" world "$PLAN" --check
