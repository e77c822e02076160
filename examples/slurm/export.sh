#!/bin/bash
#SBATCH --job-name=lpvbake-export --nodes=1 --ntasks=1
# Makes one volume of the tiles of a lighting, SCENARIO, which programs take that know of no tiles; it
# takes the memory of one grid.
exec "${LPVBAKE:-lpvbake}" convert "$PLAN" "$VOLUME" --scenario "$SCENARIO"
