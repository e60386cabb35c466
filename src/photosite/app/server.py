"""The server of the page and its API, bound to this machine.

Every request needs the key of the link that `photosite serve` prints. `GET /openapi.json` describes the API; a notebook
sends the key as `Authorization: Bearer KEY`.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import socket
import time
import uuid
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import FastAPI, Query, Request
from fastapi import Path as ApiPath
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, Response
from pydantic import Field
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

import photosite
from photosite.app import views
from photosite.app.copy_text import command_text, python_text
from photosite.app.exact_frame import exact_frame, prepare_frames, saved_frame
from photosite.app.files import (
    FileEntry,
    FileKind,
    FrameFolder,
    Upload,
    UploadKind,
    check_frame,
    check_upload,
    listed,
    store,
)
from photosite.app.form import Form, form
from photosite.app.guard import App, Guard
from photosite.app.places import UPLOAD, Part, Places, Text
from photosite.app.quality_values import ValueInfo, known_values
from photosite.app.state import TOO_DEEP, CameraState, SensorState
from photosite.app.view import prepare_views, view_bytes
from photosite.app.view_pixels import View
from photosite.app.workers import BusyError, Job, Pool, Queue, WorkerError
from photosite.errors import InputError, PhotositeError
from photosite.files.writing import TemporaryFolder

_KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
_KEPT_BYTES = 2 << 30
"""Frames and mean images kept on disk, the ones used last."""
_KEPT_RESULTS = 16
"""Results whose files can be downloaded, the last ones."""
_VIEW_S = 120.0
_MOST_UPLOADS = 32
_FOLDER_FILES = 32
"""Limit of a folder of frames, in uploads of the largest size."""

TabId = Annotated[str, Field(pattern="^[0-9a-zA-Z-]{1,40}$", description="Any name of the caller's tab.")]


class ViewRequest(Part):
    """A view of a state."""

    state: CameraState = CameraState()
    view: View = View()
    tab: TabId = "api"


class FrameRequest(Part):
    """The exact frame of a state."""

    state: CameraState = CameraState()
    tab: TabId = "api"


class SaveRequest(Part):
    """A file of the exact frame."""

    state: CameraState = CameraState()
    suffix: Literal[".dng", ".tif", ".png"] = ".dng"


class FormRequest(Part):
    """The fields for a sensor and a scene."""

    sensor: SensorState = SensorState()
    scene: Text = "macbeth"


class Code(Part):
    """A state as Python code and as a command."""

    python: str
    command: str


class JobInfo(Part):
    """A job of the queue. `result` is there when `status` is done, `error` when it is failed.

    `seconds` is the time of the computation, so far or in all; `done` of `total` parts of `what` are done.
    """

    id: str
    kind: str
    status: Literal["queued", "running", "done", "failed", "cancelled"]
    done: int = 0
    total: int = 0
    what: str = ""
    seconds: float = 0.0
    result: Any = None
    error: str = ""


class Error(Part):
    """Why a request was refused."""

    error: str


class ServerInfo(Part):
    """The server and what it serves."""

    version: str
    folder: str | None
    upload_bytes: int
    cores: int


class ParameterInfo(Part):
    """A parameter of a calibration."""

    name: str
    label: str
    unit: str


@dataclass
class Settings:
    """Settings of the server.

    Parameters
    ----------
    folder
        The served folder; None serves no files.
    upload_bytes
        Limit of an upload.
    pictures, jobs
        Number of worker processes for pictures and for jobs.
    job_s, memory_bytes
        Time limit of a job, and memory limit of each process; 0 bytes is three quarters of the machine's memory.
    """

    folder: Path | None = None
    upload_bytes: int = 256 << 20
    pictures: int = field(default_factory=lambda: max(min(os.cpu_count() or 1, 4), 2))
    jobs: int = 2
    job_s: float = 1800.0
    memory_bytes: int = 0


class Workbench:
    """The worker processes, uploads and kept frames of a server."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._temporary = TemporaryFolder()
        self.folder = self._temporary.path
        (self.folder / "kept").mkdir()
        (self.folder / "results").mkdir()
        self.uploads: dict[str, Path] = {}
        self.described: dict[str, Upload] = {}
        self._arriving = 0
        memory = settings.memory_bytes or _machine_bytes() * 3 // 4
        self.pool = Pool(settings.pictures, memory, prepare_views)
        self.queue = Queue(
            settings.jobs,
            time_s=settings.job_s,
            memory_bytes=memory,
            prepare=prepare_frames,
            finished=self.tidy,
        )

    @property
    def kept(self) -> Path:
        """Folder of the frames that are kept."""
        return self.folder / "kept"

    @property
    def places(self) -> Places:
        """The files that states can name."""
        return Places(folder=self.settings.folder, uploads=dict(self.uploads), results=self.folder / "results")

    @contextmanager
    def new_upload(self) -> Iterator[None]:
        """Count an upload while it arrives; raise `InputError` if there are too many with it."""
        if len(self.uploads) + self._arriving >= _MOST_UPLOADS:
            raise InputError("too many files were uploaded", hint="Delete some, or serve a folder")
        self._arriving += 1
        try:
            yield
        finally:
            self._arriving -= 1

    def keep_upload(self, key: str, path: Path, found: Upload) -> Upload:
        """Keep an uploaded file or folder of frames and return what is known of it."""
        self.uploads[key], self.described[key] = path, found
        return found

    def delete_upload(self, key: str) -> None:
        """Delete an uploaded file or folder of frames; raise `InputError` if there is none."""
        self.described.pop(key, None)
        if self.uploads.pop(key, None) is None:
            raise InputError("upload", value=key, expected="a file that was uploaded")
        shutil.rmtree(self.folder / "uploads" / key, ignore_errors=True)

    def named(self, text: str) -> str:
        """Return a message with the names of uploaded files in place of their paths on this machine."""
        return re.sub(re.escape(str(self.folder / "uploads")) + r"[\\/][0-9a-f]{16}[\\/]?", "", text)

    def tidy(self) -> None:
        """Delete the frames used least recently where they exceed the limit, and the files of old results."""
        results = sorted((self.folder / "results").iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
        for old in results[_KEPT_RESULTS:]:
            shutil.rmtree(old, ignore_errors=True)
        found = sorted(self.kept.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
        total = 0
        for path in found:
            total += path.stat().st_size
            if total > _KEPT_BYTES:
                path.unlink(missing_ok=True)

    def close(self) -> None:
        """End the processes and delete what was kept."""
        self.pool.close()
        self.queue.close()
        self._temporary.close()


def _machine_bytes() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 8 << 30


def create_app(workbench: Workbench, port: int, token: str) -> App:
    """Return the application, guarded."""

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        yield
        workbench.close()

    refused: dict[int | str, dict[str, Any]] = {
        status: {"model": Error} for status in (400, 401, 403, 413, 421, 422, 503, 507)
    }
    app = FastAPI(
        title="photosite workbench",
        version=photosite.__version__,
        summary="The functions of the commands, for the page and for notebooks.",
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
        responses=refused,
    )
    _answer_errors(app, workbench)
    _add_page(app)
    _add_facts(app, workbench)
    _add_camera(app, workbench)
    _add_jobs(app, workbench)
    _add_files(app, workbench)
    _add_uploads(app, workbench)
    for entry in views.VIEWS:
        _add_view(app, workbench, entry)
    return Guard(app, port, token, workbench.settings.upload_bytes)


def _answer_errors(app: FastAPI, workbench: Workbench) -> None:
    @app.exception_handler(PhotositeError)
    async def invalid(_: Request, error: PhotositeError) -> JSONResponse:
        return JSONResponse({"error": workbench.named(str(error))}, 422)

    @app.exception_handler(RequestValidationError)
    async def malformed(_: Request, error: RequestValidationError) -> JSONResponse:
        found = error.errors()
        deep = [each for each in found if each["type"] == TOO_DEEP]
        first = (deep or found)[0]
        place = ".".join(str(part) for part in first["loc"] if part != "body")
        return JSONResponse({"error": f"{place}: {first['msg']}".removeprefix(": ")[:500]}, 400 if deep else 422)

    @app.exception_handler(HTTPException)
    async def refused_request(_: Request, error: HTTPException) -> JSONResponse:
        return JSONResponse({"error": str(error.detail)}, error.status_code, headers=error.headers)

    @app.exception_handler(BusyError)
    @app.exception_handler(WorkerError)
    async def failed(_: Request, error: Exception) -> JSONResponse:
        return JSONResponse({"error": workbench.named(str(error))}, 503)

    @app.exception_handler(ClientDisconnect)
    async def gone(_: Request, __: ClientDisconnect) -> JSONResponse:
        return JSONResponse({"error": "the connection was closed"}, 400)


def _add_page(app: FastAPI) -> None:
    """Add a route for each file of the page: no path of a request is ever a path on disk."""
    for entry in (resources.files("photosite.app") / "static").iterdir():
        kind = _KINDS.get(Path(entry.name).suffix)
        if kind is not None:
            answer = _fixed_answer(entry.read_bytes(), f"{kind}; charset=utf-8")
            route = "/" if entry.name == "index.html" else f"/{entry.name}"
            app.add_api_route(route, answer, methods=["GET"], include_in_schema=False, response_class=Response)


def _fixed_answer(content: bytes, media_type: str) -> Callable[[], Response]:
    return lambda: Response(content, media_type=media_type)


def _add_facts(app: FastAPI, workbench: Workbench) -> None:
    @app.get("/api/server")
    def server() -> ServerInfo:
        """Return the server's version and limits."""
        folder = workbench.settings.folder
        return ServerInfo(
            version=photosite.__version__,
            folder=None if folder is None else str(folder.resolve()),
            upload_bytes=workbench.settings.upload_bytes,
            cores=os.cpu_count() or 1,
        )

    @app.post("/api/form")
    def fields(request: FormRequest) -> Form:
        """Return the fields of the camera view, with units, limits and the sensor's values."""
        return form(request.sensor, request.scene, workbench.places)

    @app.get("/api/charts")
    def charts() -> list[str]:
        """Return the charts that image quality is measured on."""
        from photosite.metrics.registry import charts_measured

        return list(charts_measured())

    @app.get("/api/values")
    def values() -> list[ValueInfo]:
        """Return the values of image quality that comparisons and sweeps take."""
        return known_values()

    @app.get("/api/parameters")
    def parameters() -> list[ParameterInfo]:
        """Return what a plan can reach."""
        from photosite.studies.planning import PLANNED_LABELS

        return [ParameterInfo(name=name, label=one.label, unit=one.unit) for name, one in PLANNED_LABELS.items()]


def _add_camera(app: FastAPI, workbench: Workbench) -> None:
    @app.post("/api/view", response_class=Response, responses={200: {"content": {"application/octet-stream": {}}}})
    def view(request: ViewRequest) -> Response:
        """Return the pixels in view: those of the exact frame where it was computed, else a preview.

        The body is the length of a JSON header (4 bytes, little endian), the header, (rows, cols) mean
        electrons as float32, digital numbers as the header's `dn_type`, and (rows, cols, 4) bytes of the picture.
        """
        arguments = (request.state, workbench.places, request.view, workbench.kept)
        content = workbench.pool.call(request.tab, view_bytes, *arguments, time_s=_VIEW_S)
        return Response(content, media_type="application/octet-stream")

    @app.post("/api/frames", status_code=202)
    def frame(request: FrameRequest) -> JobInfo:
        """Compute the exact frame; a new request of a tab cancels its last one."""
        arguments = (request.state, workbench.places, workbench.kept)
        return _info(workbench, workbench.queue.add("frame", request.tab, exact_frame, *arguments, replaces=True))

    @app.post("/api/save", response_class=Response, responses={200: {"content": {"application/octet-stream": {}}}})
    def save(request: SaveRequest) -> Response:
        """Return the exact frame as DNG or TIFF, or its developed picture as PNG."""
        arguments = (request.state, workbench.places, workbench.kept, request.suffix)
        job = workbench.queue.add("save", f"save-{uuid.uuid4()}", saved_frame, *arguments)
        while job.status in ("queued", "running"):
            time.sleep(0.02)
        content, job.result = job.result, None  # not kept
        if job.status != "done":
            raise WorkerError(job.error or "the job was cancelled")
        named = {"content-disposition": f'attachment; filename="shot{request.suffix}"'}
        return Response(content, media_type="application/octet-stream", headers=named)

    @app.post("/api/code")
    def code(state: CameraState) -> Code:
        """Return Python code and a command that reproduce the frame of a state."""
        places = workbench.places
        return Code(python=python_text(state, places), command=command_text(state, places))


def _add_jobs(app: FastAPI, workbench: Workbench) -> None:
    @app.get("/api/jobs/{job_id}")
    def job(job_id: str) -> JobInfo:
        """Return a job, with its result once it is done."""
        return _info(workbench, _job(workbench, job_id))

    @app.delete("/api/jobs/{job_id}")
    def cancel(job_id: str) -> JobInfo:
        """Cancel a job and free its processor."""
        found = _job(workbench, job_id)
        workbench.queue.cancel(found)
        return _info(workbench, found)


def _add_files(app: FastAPI, workbench: Workbench) -> None:
    @app.get("/api/files")
    def files_of(kind: FileKind | Literal["folder"] = "scene") -> list[FileEntry]:
        """Return the files, or the folders, of the served folder."""
        return listed(workbench.settings.folder, kind)

    @app.get("/api/results/{result}/{name}", response_class=Response)
    def result_file(
        result: Annotated[str, ApiPath(pattern="^[0-9a-f]{16}$")], name: Annotated[str, ApiPath(max_length=100)]
    ) -> Response:
        """Return a file of a result."""
        folder = workbench.folder / "results" / result
        listed = [path for path in folder.iterdir() if not path.name.startswith(".")] if folder.is_dir() else []
        found = next((path for path in listed if path.name == name), None)
        if found is None:
            raise InputError("file", value=name, expected="one of a result that is kept", hint="Compute it again")
        return FileResponse(found, media_type="application/octet-stream", filename=found.name)


def _add_uploads(app: FastAPI, workbench: Workbench) -> None:
    @app.post("/api/uploads", status_code=201)
    async def upload(
        request: Request,
        name: Annotated[str, Query(max_length=200)],
        kind: UploadKind = "scene",
        folder: Annotated[str, Query(max_length=100)] = "",
    ) -> Upload:
        """Store the body of the request as a file, after a guarded child process could read it.

        Frames go to a folder: that of an earlier upload, `folder`, or a new one. Their names can have one folder.
        """
        from starlette.concurrency import run_in_threadpool

        if kind == "frames" and folder:
            place = FrameFolder.of(workbench.uploads.get(folder.removeprefix(UPLOAD)))
            return await _frame_upload(workbench, place, name, request, new=False)
        with workbench.new_upload():
            if kind == "frames":
                place = FrameFolder.start(workbench.folder / "uploads")
                return await _frame_upload(workbench, place, name, request, new=True)
            path = await store(workbench.folder / "uploads", name, kind, request.stream())
            holds = await run_in_threadpool(check_upload, path, kind)
            key = path.parent.name
            found = Upload(name=UPLOAD + key, kind=kind, file_name=path.name, bytes=path.stat().st_size, holds=holds)
            return workbench.keep_upload(key, path, found)

    @app.get("/api/uploads")
    def uploads() -> list[Upload]:
        """Return the uploaded files and folders of frames."""
        return list(workbench.described.values())

    @app.delete("/api/uploads/{key}", status_code=204)
    async def delete(key: Annotated[str, ApiPath(pattern="^[0-9a-f]{16}$")]) -> None:
        """Delete an uploaded file or folder of frames, by its name without `upload:`."""
        workbench.delete_upload(key)


async def _frame_upload(workbench: Workbench, place: FrameFolder, name: str, request: Request, *, new: bool) -> Upload:
    """Store a frame in a folder, which can be deleted meanwhile."""
    from starlette.concurrency import run_in_threadpool

    key = place.path.name
    stored = await place.store(name, request.stream(), workbench.settings.upload_bytes * _FOLDER_FILES)
    holds = await run_in_threadpool(check_frame, stored)
    if not new and key not in workbench.uploads:
        shutil.rmtree(place.path, ignore_errors=True)
        raise InputError("folder", value=key, expected="one of uploaded frames", hint="It was deleted meanwhile")
    sizes = place.sizes()
    found = Upload(name=UPLOAD + key, kind="frames", file_name=stored.name, bytes=stored.stat().st_size, holds=holds)
    number = "1 frame" if len(sizes) == 1 else f"{len(sizes)} frames"
    workbench.keep_upload(
        key, place.path, found.model_copy(update={"bytes": sum(sizes), "holds": f"{number}, {holds}"})
    )
    return found


def _add_view(app: FastAPI, workbench: Workbench, entry: views.JobView) -> None:
    """Add a request that starts a job, and one for its code."""
    request_type = entry.request

    def start(request: request_type, tab: TabId = "api") -> JobInfo:  # type: ignore[valid-type]
        return _info(
            workbench, workbench.queue.add(entry.name, tab, entry.compute, request, workbench.places, replaces=True)
        )

    def text(request: request_type) -> Code:  # type: ignore[valid-type]
        python, command = entry.code(request, workbench.places)
        return Code(python=python, command=command)

    start.__doc__, text.__doc__ = entry.summary, f"Return code that does the same as /api/{entry.name}."
    start.__annotations__["request"] = text.__annotations__["request"] = request_type
    app.post(f"/api/{entry.name}", status_code=202, operation_id=entry.name)(start)
    app.post(f"/api/{entry.name}/code", operation_id=f"{entry.name}_code")(text)


def _job(workbench: Workbench, job_id: str) -> Job:
    found = workbench.queue.get(job_id)
    if found is None:
        raise InputError("job", value=job_id[:40], expected="the id of a job that is kept")
    return found


def _info(workbench: Workbench, job: Job) -> JobInfo:
    done, total, what = job.progress
    return JobInfo(
        id=job.id,
        kind=job.kind,
        status=job.status,
        done=done,
        total=total,
        what=what,
        seconds=job.seconds,
        result=job.result if job.status == "done" else None,
        error=workbench.named(job.error),
    )


def serve(settings: Settings, port: int, started: Callable[[str], object]) -> None:
    """Serve the page until the process is interrupted.

    Parameters
    ----------
    settings
        The served folder and the limits.
    port
        Port on 127.0.0.1; 0 is any free one.
    started
        Called with the link once the server is bound.

    Raises
    ------
    InputError
        If the port is in use.
    """
    import uvicorn

    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as bound:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            bound.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError("port", value=port, expected=f"free: {error.strerror}") from None
        port = bound.getsockname()[1]
        token = secrets.token_urlsafe(32)
        app = create_app(Workbench(settings), port, token)
        config = uvicorn.Config(
            app,
            log_level="error",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            limit_concurrency=128,
            timeout_keep_alive=30,
            ws="none",
        )
        started(f"http://127.0.0.1:{port}/?token={token}")
        uvicorn.Server(config).run(sockets=[bound])
