"""The program that the controller runs: its threads take turns, each up to its next wait, once a period."""

from collections.abc import Callable, Generator

from sim.controller.urscript import ScriptError, translate


class Thread:
    """One thread of the program."""

    def __init__(self, run: Generator[None, None, object], name: str) -> None:
        self.run, self.name, self.alive = run, name, True
        self._runs = False
        """Whether it has its turn at this moment: then it ends at its next wait."""

    def step(self) -> None:
        """Up to its next wait."""
        self._runs = True
        try:
            next(self.run)
        except StopIteration:
            self.alive = False
        finally:
            self._runs = False

    def end(self) -> None:
        """Stop it where it is."""
        self.alive = False
        if not self._runs:
            self.run.close()


class Program:
    """A running program; the first thread is the main one, and its end is the program's."""

    def __init__(self, source: str, functions: dict[str, Callable], blocking: frozenset[str]) -> None:
        """Translate and load.

        Raises:
            ScriptError: It is not understood.
        """
        script = translate(source, blocking)
        main = script.load(functions | {"__run": self._run, "__kill": self._kill})
        self.name = script.name
        self.current = Thread(main(), script.name)
        """The thread whose turn it is."""
        self._threads = [self.current]

    @property
    def running(self) -> bool:
        """Whether the main thread has not ended."""
        return self._threads[0].alive

    def step(self) -> None:
        """One period: every thread up to its next wait; threads that start in it have their turn as well.

        Raises:
            ScriptError: What the program does is not possible.
        """
        for thread in self._threads:
            if not thread.alive:
                continue
            self.current = thread
            try:
                thread.step()
            except ScriptError:
                raise
            except (ArithmeticError, LookupError, NameError, TypeError, ValueError) as error:
                raise ScriptError(f"{thread.name}: {error}", error) from error
            if not self.running:
                return
        self._threads = [thread for thread in self._threads if thread.alive]

    def end(self) -> None:
        """Stop all threads."""
        for thread in self._threads:
            thread.end()

    def _run(self, function: Callable, *arguments: object) -> Thread:
        thread = Thread(function(*arguments), function.__name__)
        self._threads.append(thread)
        return thread

    def _kill(self, thread: object) -> None:
        if isinstance(thread, Thread):
            thread.end()
