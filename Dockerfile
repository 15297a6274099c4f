# The base image is an argument so that a mirror, or an image made elsewhere, can take its place.
ARG BASE_IMAGE=python:3.12-slim
FROM ${BASE_IMAGE} AS build
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY twin twin
COPY detectors detectors
COPY service service
COPY migrations migrations
RUN python3 -m venv /opt/casedrain && /opt/casedrain/bin/pip install --no-cache-dir .
# Compiled once here, so that no start and no request pays for it. Numba keys compiled code by the processor's name and
# would compile again on another kind than the build ran on, at every start: so it is written for any of the architecture.
# An image for one kind: --build-arg CPU=znver3 (a name of LLVM's); it then starts slowly elsewhere but not wrongly.
ARG CPU=generic
ENV CASEDRAIN_COMPILE_CACHE=/opt/casedrain/cache \
    NUMBA_CPU_NAME=${CPU}
RUN cd / && /opt/casedrain/bin/python -m detectors.warm_up

ARG BASE_IMAGE=python:3.12-slim
FROM ${BASE_IMAGE}
RUN useradd --system --uid 10001 --home-dir /var/lib/casedrain --create-home casedrain
COPY --from=build /opt/casedrain /opt/casedrain
ENV PATH=/opt/casedrain/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    CASEDRAIN_COMPILE_CACHE=/opt/casedrain/cache \
    CASEDRAIN_DATA_DIR=/var/lib/casedrain \
    CASEDRAIN_AUTH=on \
    MPLCONFIGDIR=/tmp/matplotlib
USER casedrain
ARG CPU=generic
ENV NUMBA_CPU_NAME=${CPU}
# docker build --build-arg COMMIT=$(git rev-parse HEAD): what verdicts and /readyz say that they were made by
ARG COMMIT=
ENV CASEDRAIN_COMMIT=${COMMIT}
WORKDIR /var/lib/casedrain
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=8s --start-period=60s --retries=6 \
    CMD ["python3", "-c", "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8000/readyz', timeout=7)"]
CMD ["sh", "-c", "casedrain db upgrade && exec casedrain serve --host 0.0.0.0 --port 8000"]
