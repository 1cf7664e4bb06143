"""A bucket of S3 on a free port of this machine: moto, with writes that are as atomic as those of S3.

S3 decides about `If-None-Match: *` and writes in one step. Moto looks first and writes afterwards, in a thread for each
request, so that two requests may both find a name free. They take turns here, after their bodies have come.
"""

import io
import threading

import moto.server


class Application(moto.server.DomainDispatcherApplication):
    """Moto's application, where one conditional write follows the other."""

    turn = threading.Lock()

    def __call__(self, environ, start_response):
        if "HTTP_IF_NONE_MATCH" not in environ or environ["REQUEST_METHOD"] not in ("PUT", "POST"):
            return super().__call__(environ, start_response)
        body = environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
        environ["wsgi.input"] = io.BytesIO(body)
        with self.turn:
            return super().__call__(environ, start_response)


moto.server.DomainDispatcherApplication = Application
moto.server.main(["-H", "127.0.0.1", "-p", "0"])
