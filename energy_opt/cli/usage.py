"""What is at the end of each verb's --help: an example that works, the files that are read and written, units."""

from __future__ import annotations

UNITS = "Units are SI: rad (m for prismatic joints), s, N m (N), W, J. Joints are matched by name, never by order."

MOVE = "--robot panda --start 0,-0.785,0,-2.356,0,1.571,0.785 --goal 1.2,0.3,0.4,-1.2,-0.5,2.2,-0.4"

# Verb -> commands that work one after the other in an empty folder, what is read, what is written.
USAGE: dict[str, tuple[tuple[str, ...], str, str]] = {
    "optimize": (
        (f"energy-opt optimize {MOVE} --duration 2 --floor 0 --out out",),
        "a URDF or a robot's name; paths and trajectories (CSV, YAML or JSON messages, bags); model (TOML); limits "
        "(joint_limits.yaml); scene (YAML, JSON, .scene)",
        "result.json, trajectory.csv (time, <joint>.position, .velocity, .acceleration, .effort, power), "
        "trajectory.yaml (trajectory_msgs/JointTrajectory), plot.png, report.html; what --write asks for",
    ),
    "tradeoff": (
        (f"energy-opt tradeoff {MOVE} --mode retime --durations 1:4:7 --cycle 5 --out front",),
        "as optimize does",
        "tradeoff.csv (duration, energy_total, energy_standby, energy_loss, status), tradeoff.json, plot.png, "
        "report.html, trajectory_minimum.csv",
    ),
    "bench": (
        ("energy-opt --example suite > suite.toml", "energy-opt bench suite.toml --jobs 2 --out batch"),
        "a suite (TOML, `energy-opt --example suite`)",
        "results.parquet (a row per move), summary.json, report.html; results.jsonl while it runs",
    ),
    "job": (
        ("energy-opt --example job > job.toml", "energy-opt job job.toml --out cycle"),
        "a job (TOML, `energy-opt --example job`)",
        "job.json, step_01.csv and so on, cycle.csv, report.html",
    ),
    "place": (
        ("energy-opt place job.toml --base-box=-0.3,0.3,-0.3,0.3,0,0 --out placed",),
        "a job (TOML) with steps that end at poses of the tool (`pose = [...]`)",
        "place.json, map.png, report.html, and the job solved at the answer in job/ (as `job` writes it)",
    ),
    "evaluate": (
        (
            f"energy-opt optimize {MOVE} --mode retime --duration 2 --out out",
            "energy-opt evaluate out/trajectory.csv --write follow-joint-trajectory --rate 100 --out judged",
        ),
        "trajectories (CSV, messages, bags, programs), recordings, and results of optimize and job",
        "evaluate.json (motions: energy under every model, certificate, baselines), what --write asks for",
    ),
    "identify": (
        (
            "energy-opt identify --robot panda --suggest 8 --out poses",
            "energy-opt identify SET --out identified",
        ),
        "a measured set: a folder with log.toml (`energy-opt --example log`) and its tables",
        "model_method1.toml, model_method2.toml, identify.json, plot.png, report.html; with --suggest "
        "suggested_poses.csv",
    ),
    "diagnose": (
        ("energy-opt diagnose SET --model declared.toml --out diagnosis",),
        "a measured set, and the declared model (TOML)",
        "diagnosis.json, model.toml (for optimize --model), report.html, next_motion.csv where data do not suffice",
    ),
    "import": (
        ("energy-opt import joints.csv meter.csv --out set",),
        "tables of any dialect with a header, recordings of UR and Franka arms, bags (extra [ros])",
        "log.toml and its tables",
    ),
    "passport": (
        ("energy-opt passport panda --out passport", "energy-opt passport march.toml november.toml --out compared"),
        "model files (TOML), such as the model.toml of `diagnose`; or names of robots",
        "passport.json, report.html",
    ),
    "simulate": (
        (
            f"energy-opt optimize {MOVE} --mode retime --duration 2 --out out",
            "energy-opt --example model > plant.toml",
            "energy-opt simulate out/trajectory.csv --plant plant.toml --repeat 3 --static 4 --out set",
        ),
        "trajectories (CSV, YAML or JSON messages, bags) and the plant's model (TOML)",
        "a measured set: log.toml, run01.csv and so on, truth.toml; declared.toml with --model",
    ),
    "check": (
        ("energy-opt --example limits > joint_limits.yaml", "energy-opt check joint_limits.yaml --robot panda"),
        "logs, trajectories, models, limits, suites, scenes, jobs, URDFs",
        "nothing; faults go to stderr, one line each; exit code 2 where there are any",
    ),
    "run": (
        (f"energy-opt optimize {MOVE} --duration 2 --out out", "energy-opt run out/result.json --out again"),
        "a request (JSON), or a result that holds one",
        "what its verb writes",
    ),
    "robots": (("energy-opt robots panda",), "a URDF, where one is given", "nothing"),
    "effects": (("energy-opt effects coulomb_friction",), "effects of your own with --effects FILE.py", "nothing"),
}


def epilog(verb: str) -> str:
    """The text below a verb's options."""
    commands, read, written = USAGE[verb]
    title = "example:" if len(commands) == 1 else "example, in this order:"
    if verb in ("identify", "passport"):
        title = "examples:"
    return "\n".join([title, *(f"  {line}" for line in commands), "", f"reads: {read}", f"writes: {written}", UNITS])
