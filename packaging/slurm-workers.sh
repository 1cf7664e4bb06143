#!/bin/bash
# Workers of a Packstone server as an array of Slurm (docs/cluster.md, "Slurm with pilots"):
#
#   export PACKSTONE_SERVER=http://login1:8080 PACKSTONE_KEY_FILE=$HOME/packstone-worker.key
#   sbatch --array=0-19 --time=8:00:00 slurm-workers.sh
#
# Options on the command line precede those below. Each worker packs as many jobs at once as it has cores, releases them
# with last checkpoints a minute before its time limit, and ends by itself when it had no job for ten minutes.
#SBATCH --job-name=packstone-worker
#SBATCH --array=0-3
#SBATCH --time=4:00:00
#SBATCH --cpus-per-task=4
#SBATCH --mem-per-cpu=2G
# Should the worker not know its time limit, Slurm sends SIGTERM in time.
#SBATCH --signal=B:TERM@120
#SBATCH --output=packstone-worker-%A_%a.log
export PACKSTONE_IDLE_EXIT_S=${PACKSTONE_IDLE_EXIT_S-600}
# The signal goes to this process: it must become the worker.
exec "${PACKSTONE:-packstone}" worker --until auto
