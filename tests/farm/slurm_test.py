"""A world baked by a Slurm cluster: rows.sh, check.sh and export.sh of examples/slurm, with tasks that are
killed, and on a node that goes down; and by Make.

    slurm_test.py LPVBAKE SCENE EXAMPLES

Starts a cluster of one node with two processors on loopback, everything below one folder, and ends it.
Needs root, slurm-wlm and munge. Slurm's daemons bind to what the host's name stands for: where that is no
loopback address, the test runs in namespaces of its own, of which the host is called localhost.
"""
import hashlib
import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest

LPVBAKE, SCENE, EXAMPLES = (pathlib.Path(arg).resolve() for arg in sys.argv[1:4])
ROWS = 24  # of a task


def is_on_loopback():
    """Whether the host's name stands for a loopback address."""
    try:
        return socket.gethostbyname(socket.gethostname()).startswith("127.")
    except OSError:
        return False


def seal_off():
    """Runs the test anew where the host's name stands for a loopback address, if it does not here."""
    if is_on_loopback():
        return
    unshare = ["unshare", "--net", "--uts", "--pid", "--fork", "--kill-child", "--mount-proc"]
    able = (all(map(shutil.which, ("unshare", "ip", "hostname"))) and "LPVBAKE_SEALED_OFF" not in os.environ
            and subprocess.run([*unshare, "true"], stderr=subprocess.DEVNULL, check=False).returncode == 0)
    if not able:
        sys.exit(f"the host's name, {socket.gethostname()}, stands for no loopback address: put '127.0.0.1 "
                 f"{socket.gethostname()}' first in /etc/hosts, or run this as root with CAP_SYS_ADMIN and iproute2")
    os.environ["LPVBAKE_SEALED_OFF"] = "1"
    # A second address: names resolve to IPv4 only where there is one besides 127.0.0.1 (AI_ADDRCONFIG).
    os.execvp("unshare", [*unshare, "sh", "-c", "ip link set lo up && ip addr add 127.0.0.2/8 dev lo && "
                          "hostname localhost && exec \"$@\"", "sh", sys.executable, *sys.argv])


def free_ports():
    """Two that follow each other."""
    for port in range(16817, 17817, 2):
        with socket.socket() as one, socket.socket() as other:
            try:
                one.bind(("127.0.0.1", port))
                other.bind(("127.0.0.1", port + 1))
                return port
            except OSError:
                continue
    raise RuntimeError("no free ports")


def wait_until(happens, seconds, what):
    end = time.monotonic() + seconds
    while not (value := happens()):
        if time.monotonic() > end:
            raise TimeoutError(what)
        time.sleep(0.05)
    return value


class Cluster:
    """munged, slurmctld and slurmd."""

    def __init__(self, folder):
        self.folder = folder
        host, port = socket.gethostname(), free_ports()
        for name in ("munge", "state", "spool", "log"):
            (folder / name).mkdir(parents=True)
        for path in (folder.parent, folder, folder / "munge"):
            path.chmod(0o755)  # munged wants every folder above its socket to be open to all
        key = folder / "munge/key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o600)
        settings = {
            "ClusterName": "lpvbake", "SlurmctldHost": f"{host}(127.0.0.1)", "SlurmUser": "root", "SlurmdUser": "root",
            "SlurmctldPort": port, "SlurmdPort": port + 1,
            "CommunicationParameters": "NoCtldInAddrAny,NoInAddrAny",
            # A task that is requeued waits as long as a credential lives: two minutes unless this is said.
            "AuthType": "auth/munge", "AuthInfo": f"socket={folder}/munge/socket,cred_expire=5",
            "CredType": "cred/munge", "StateSaveLocation": folder / "state", "SlurmdSpoolDir": folder / "spool",
            "SlurmctldPidFile": folder / "slurmctld.pid", "SlurmdPidFile": folder / "slurmd.pid",
            "SlurmctldLogFile": folder / "log/slurmctld.log", "SlurmdLogFile": folder / "log/slurmd.log",
            "ProctrackType": "proctrack/linuxproc", "TaskPlugin": "task/none",
            "JobAcctGatherType": "jobacct_gather/none", "AccountingStorageType": "accounting_storage/none",
            "MpiDefault": "none", "SwitchType": "switch/none", "SelectType": "select/cons_tres",
            "SelectTypeParameters": "CR_CPU", "SchedulerType": "sched/backfill",
            "SchedulerParameters": "batch_sched_delay=0,sched_interval=1,bf_interval=1", "JobRequeue": 1,
            "KillWait": 2, "MinJobAge": 3600, "ReturnToService": 2, "MailProg": "/bin/true",
        }
        conf = folder / "slurm.conf"
        conf.write_text("".join(f"{name}={value}\n" for name, value in settings.items())
                        + f"NodeName={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory=1000 State=UNKNOWN\n"
                        + "PartitionName=bake Nodes=ALL Default=YES MaxTime=INFINITE State=UP\n")
        os.environ["SLURM_CONF"] = str(conf)
        self.daemons = []
        try:
            self.start("munged", "--foreground", f"--key-file={key}", f"--socket={folder}/munge/socket",
                       f"--pid-file={folder}/munge/pid", f"--seed-file={folder}/munge/seed",
                       f"--log-file={folder}/log/munged.log", "--num-threads=2")
            wait_until((folder / "munge/socket").exists, 10, "munged")
            self.start("slurmctld", "-D")
            self.start_node()
        except BaseException:
            self.stop()
            for log in sorted((folder / "log").iterdir()):
                print(f"--- {log.name}\n{log.read_text(errors='replace')[-2000:]}", file=sys.stderr)
            raise

    def start(self, name, *arguments):
        with open(self.folder / "log" / f"{name}.out", "w") as log:
            self.daemons.append(subprocess.Popen([name, *arguments], stdin=subprocess.DEVNULL, stdout=log,
                                                 stderr=log, start_new_session=True))

    def start_node(self):
        self.start("slurmd", "-D", "-N", socket.gethostname())
        wait_until(lambda: output("sinfo", "-h", "-o", "%T") == "idle", 30, "the node is idle")

    def lose_node(self, bakes):
        """Its power fails while these run; the controller, which waits minutes for a node, is told."""
        slurmd = self.daemons.pop()
        slurmd.kill()
        slurmd.wait()
        for bake in bakes:
            script = parent_of(bake)
            for process in (parent_of(script), script, bake):  # what watches a task comes first
                os.kill(process, signal.SIGKILL)
        subprocess.run(["scontrol", "update", f"nodename={socket.gethostname()}", "state=down", "reason=power"], check=True)

    def stop(self):
        for daemon in reversed(self.daemons):
            daemon.terminate()
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()


def output(*command):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False).stdout.strip()


def state_of(job):
    """What Slurm says of a job or of a task of an array, as JOB_TASK."""
    fields = output("scontrol", "show", "job", job, "-o").split()
    return dict(field.split("=", 1) for field in fields if "=" in field)


def parent_of(process):
    return int(output("ps", "-o", "ppid=", "-p", str(process)))


def bake_of(rows):
    """The id of the program that bakes these rows, if one runs."""
    found = output("pgrep", "-f", f"^{LPVBAKE} world .* --rows {rows}$").split()
    return int(found[0]) if found else None


class Farm(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = tempfile.TemporaryDirectory(prefix="lpvbake_farm.")
        cls.addClassCleanup(cls.root.cleanup)
        root = pathlib.Path(cls.root.name)
        cls.cluster = Cluster(root / "cluster")
        cls.addClassCleanup(cls.cluster.stop)
        cls.hand = cls.plan_in(root / "hand")
        subprocess.run([LPVBAKE, "world", cls.hand, "--rows", f"0-{cls.count - 1}", "-q"], check=True,
                       stdout=subprocess.DEVNULL)

    @classmethod
    def plan_in(cls, folder, scenarios=("day:--point 0,1,0,100", "night:--point 0.5,0.5,0,10")):
        """A room as 48 tiles in each lighting."""
        folder.mkdir()
        plan = folder / "room.world.json"
        subprocess.run([LPVBAKE, "world", SCENE, "-o", plan, "--cell-size", "0.1", "--tile", "8", "--surroundings", "3",
                        *(f"--scenario={each}" for each in scenarios), "-q"],
                       check=True, stdout=subprocess.DEVNULL)
        cls.count = len(json.loads(plan.read_text())["rows"])
        return plan

    def submit(self, plan, dependency):
        """An array of all rows, and a check after it."""
        tasks = -(-self.count // ROWS)
        environment = f"--export=ALL,LPVBAKE={LPVBAKE},PLAN={plan},ROWS={ROWS}"
        self.array = output("sbatch", "--parsable", f"--array=0-{tasks - 1}", environment,
                            f"--output={plan.parent}/%a.log", str(EXAMPLES / "slurm/rows.sh"))
        self.check = output("sbatch", "--parsable", f"--dependency={dependency}:{self.array}", environment,
                            f"--output={plan.parent}/check.log", str(EXAMPLES / "slurm/check.sh"))
        self.assertTrue(self.array and self.check)

    def settle(self, seconds=120, job=None):
        job = job or self.check

        def ended():
            return state_of(job).get("JobState") not in ("PENDING", "RUNNING", "COMPLETING", None)
        wait_until(ended, seconds, f"{state_of(job)} after {output('squeue')}")
        return state_of(job)

    def hashes(self, plan):
        return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in plan.parent.glob("*.vdb")}

    def test_killed_tasks_come_back_and_nothing_is_lost(self):
        plan = self.plan_in(pathlib.Path(self.root.name) / "killed")
        self.submit(plan, "afterok")
        volume = pathlib.Path(self.root.name) / "night.vdb"
        export = output("sbatch", "--parsable", f"--dependency=afterok:{self.check}", f"--output={plan.parent}/export.log",
                        f"--export=ALL,LPVBAKE={LPVBAKE},PLAN={plan},SCENARIO=night,VOLUME={volume}",
                        str(EXAMPLES / "slurm/export.sh"))
        for task in (1, 2):  # the machine takes the memory of one, a user wants the node of the other
            bake = wait_until(lambda: bake_of(f"{task * ROWS}-{task * ROWS + ROWS - 1}"), 60, f"task {task} runs")
            time.sleep(0.3)
            os.kill(bake, signal.SIGKILL if task == 1 else signal.SIGTERM)
        state = self.settle()
        self.assertEqual(state["JobState"], "COMPLETED", (plan.parent / "check.log").read_text())
        for task, code in ((1, 137), (2, 143)):
            self.assertIn(f"ended with {code}, again", (plan.parent / f"{task}.log").read_text())
        self.assertEqual(self.hashes(plan), self.hashes(self.hand))
        self.assertEqual(len(self.hashes(plan)), self.count)
        self.assertEqual(self.settle(job=export)["JobState"], "COMPLETED", (plan.parent / "export.log").read_text())
        by_hand = volume.with_name("hand.vdb")
        subprocess.run([LPVBAKE, "convert", self.hand, by_hand, "--scenario", "night"], check=True, stdout=subprocess.DEVNULL)
        self.assertEqual(volume.read_bytes(), by_hand.read_bytes())
        self.assertEqual([path for path in plan.parent.iterdir() if path.suffix not in (".vdb", ".json", ".log")], [])

        # The same lines again bake nothing.
        before = {path: path.stat().st_mtime_ns for path in plan.parent.glob("*.vdb")}
        self.submit(plan, "afterok")
        self.assertEqual(self.settle()["JobState"], "COMPLETED")
        self.assertEqual(before, {path: path.stat().st_mtime_ns for path in plan.parent.glob("*.vdb")})

    def test_a_node_goes_down_and_its_tasks_come_back(self):
        plan = self.plan_in(pathlib.Path(self.root.name) / "down", ["day:--point 0,1,0,100"])
        self.submit(plan, "afterok")
        rows = [f"{task * ROWS}-{task * ROWS + ROWS - 1}" for task in (0, 1)]  # that a node of two processors runs
        bakes = wait_until(lambda: all(ids := [bake_of(each) for each in rows]) and ids, 60, "two tasks run")
        self.cluster.lose_node(bakes)
        for task in (0, 1):
            wait_until(lambda task=task: state_of(f"{self.array}_{task}")["JobState"] == "PENDING", 20, "it is queued again")
        self.assertLess(len(self.hashes(plan)), self.count)
        self.cluster.start_node()
        state = self.settle()
        self.assertEqual(state["JobState"], "COMPLETED", (plan.parent / "check.log").read_text())
        for task in (0, 1):
            self.assertEqual(state_of(f"{self.array}_{task}")["Restarts"], "1")
        by_hand = self.hashes(self.hand)
        self.assertEqual(self.hashes(plan), {name: by_hand[name] for name in by_hand if "_day_" in name})
        self.assertEqual(len(self.hashes(plan)), self.count)

    def test_make_bakes_the_same(self):
        plan = self.plan_in(pathlib.Path(self.root.name) / "made")
        make = ["make", "-s", "-j2", "-f", EXAMPLES / "farms/Makefile", f"LPVBAKE={LPVBAKE}", f"PLAN={plan}", f"ROWS={ROWS}"]
        subprocess.run(make, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.assertEqual(self.hashes(plan), self.hashes(self.hand))

    def test_rows_that_fail_are_named(self):
        plan = self.plan_in(pathlib.Path(self.root.name) / "failed")
        document = json.loads(plan.read_text())
        document["scenarios"][1]["options"] = ["--point", "nowhere"]  # code 1: no other try
        plan.write_text(json.dumps(document))
        self.submit(plan, "afterany")
        state = self.settle()
        self.assertEqual((state["JobState"], state["ExitCode"]), ("FAILED", "3:0"))
        check = (plan.parent / "check.log").read_text()
        for number, row in enumerate(document["rows"]):
            self.assertEqual(f"row {number} (night, {row['tile']}): {plan.parent / row['file']} is missing" in check,
                             row["scenario"] == "night", check)


if __name__ == "__main__":
    seal_off()
    unittest.main(argv=sys.argv[:1], verbosity=2)
