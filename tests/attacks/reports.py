"""Expected reports of the attacks, in heartbeats and by the doctor."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Report:
    """Expected report of an attack, or the reason why nothing is reported."""

    service: str = ""  # service whose heartbeat counts the attack
    counter: str = ""  # counter that rises
    reason: str = ""  # part of the reason of a process that is not ready
    check: str = ""  # check of the doctor that finds the fault
    nothing: str = ""  # reason why nothing is wrong and nothing may be reported

    @property
    def parts(self) -> frozenset[str]:
        """Names of the expected fields."""
        return frozenset(name for name in ("counter", "reason", "check") if getattr(self, name))


# Checks of the doctor that must find nothing if there is nothing to report; other checks may
# report a busy machine
SILENT = frozenset({"twice", "unannounced", "clocks", "exceptions", "release"})

REPORTS = {
    "garbage_on_every_topic": Report("tracker", "bad_detections", "MessagePack", "state"),
    "messages_of_one_topic_on_all_others": Report("tracker", "bad_embeddings", "got", "state"),
    "extreme_values_in_every_field": Report("tracker", "bad_detections", "expected", "state"),
    "absurd_but_finite_values": Report(
        "detector", "foreign_camera_info", "another process sends", "owners"
    ),
    "a_forged_calibration": Report(
        "tracker", "foreign_static_transforms", "another process sends", "owners"
    ),
    "a_camera_an_hour_ahead": Report(check="clocks"),
    "a_camera_half_a_second_behind": Report(check="clocks"),
    "frames_in_the_name_of_a_camera": Report(
        "tracker", "stray_frames", "does another publisher use its name?", "state"
    ),
    "a_reader_that_stops": Report(
        nothing="what it does not read is dropped by the router for it alone; no process is later"
    ),
    "embeddings_of_frames_that_do_not_exist": Report("tracker", "late_embeddings"),
    "embeddings_of_another_length": Report("tracker", "late_embeddings"),
    "invented_instances": Report("watchdog", "unannounced", check="unannounced"),
    "invented_cameras_and_frames": Report(
        "tracker", "refused_cameras", "no transform map <-", "transform"
    ),
    "as_many_messages_of_one_camera": Report(reason="no transform map <-", check="transform"),
    "invented_frames_of_one_camera": Report(reason="no transform map <-", check="transform"),
    "heartbeats_of_others": Report(check="twice"),
    "invented_replicas": Report("tracker", "missing", check="services"),
    "answers_to_every_query": Report("tracker", "clock_steps", check="clocks"),
    "queries_and_deletions_of_everything": Report(
        nothing="queries find the router's clock alone, deletions are skipped by each subscriber"
    ),
    "a_flood_of_small_messages": Report("tracker", "bad_detections", "expected", "state"),
    "frames_with_thousands_of_people": Report("tracker", "too_many"),
    "odd_keys": Report("tracker", "bad_detections", "expected", "state"),
    "many_subscribers_come_and_go": Report(
        nothing="anyone may subscribe without keys, and takes nothing from others by it"
    ),
}
