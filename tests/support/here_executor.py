"""An executor that makes calls in this process, in milliseconds."""

import pickle

from gsfw.core.errors import UserError
from gsfw.jobs.executor import Executor, StartedJob
from gsfw.jobs.job import Job, Resources
from gsfw.jobs.outcome import Outcome


class EndedJob(StartedJob):
    """A job that was done at once; what goes there and back is pickled, as between machines."""

    seconds = 0.0

    def __init__(self, job: Job, looks: int) -> None:
        self.job, self._looks = job, looks
        work = pickle.loads(pickle.dumps(job.work))
        try:
            value = work.function(*work.arguments)
        except UserError as error:
            self._outcome = Outcome(False, 0.0, error=error.message, advice=error.advice)
        else:
            self._outcome = Outcome(True, 0.0, value=pickle.loads(pickle.dumps(value)))

    def poll(self) -> Outcome | None:
        self._looks -= 1
        return self._outcome if self._looks < 0 else None

    def stop(self, once_more: bool = False) -> None:
        pass

    def wait(self) -> None:
        pass


class HereExecutor(Executor):
    """Jobs in this process; every other one takes longer, so that they end in another order."""

    def __init__(self, places: int = 2) -> None:
        self._places = places
        self.jobs: list[Job] = []

    def places(self, resources: Resources) -> int:
        return self._places

    def start(self, job: Job) -> StartedJob:
        self.jobs.append(job)
        return EndedJob(job, len(self.jobs) % 2)

    def close(self) -> None:
        pass
