"""A small HTTP server for tests, on 127.0.0.1 and a free port: serves byte strings, understands ranges, can break off."""

import http.server
import re
import threading


class RangeServer:
    """Serves `files` (path -> bytes) and records each request as (path, Range header or None)."""

    def __init__(self):
        self.files = {}
        self.requests = []
        self.supports_ranges = True
        self.break_off_after = None  # bytes of the body after which the connection is closed, once
        owner = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                owner._serve(self)

            def log_message(self, *_):
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = "http://127.0.0.1:%d" % self._server.server_address[1]
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self):
        self._server.shutdown()
        self._server.server_close()

    def _serve(self, request):
        wanted = request.headers.get("Range")
        self.requests.append((request.path, wanted))
        body = self.files.get(request.path)
        if body is None:
            request.send_error(404)
            return
        start = 0
        match = re.fullmatch(r"bytes=(\d+)-", wanted or "") if self.supports_ranges else None
        if match:
            start = int(match.group(1))
            if start >= len(body):
                request.send_response(416)
                request.send_header("Content-Range", "bytes */%d" % len(body))
                request.send_header("Content-Length", "0")
                request.end_headers()
                return
        request.send_response(206 if match else 200)
        if match:
            request.send_header("Content-Range", "bytes %d-%d/%d" % (start, len(body) - 1, len(body)))
        request.send_header("Content-Length", str(len(body) - start))
        request.end_headers()
        piece = body[start:]
        if self.break_off_after is not None:
            piece, self.break_off_after = piece[: self.break_off_after], None
        request.wfile.write(piece)
        request.close_connection = True
