# One image for every process: gateway, capture worker, training worker (metanerf); the same for a
# machine with a CUDA device (gpu), and with Ray for the nodes of a cluster (cluster); and the proxy in front.
FROM caddy:2.10.0 AS proxy
# its volumes are root's unless the image says otherwise
RUN adduser -D -H -u 10002 proxy && chown proxy /data /config
USER proxy

FROM node:20.19.2-slim AS page
WORKDIR /client
COPY client/package.json client/package-lock.json ./
RUN npm ci --no-audit --no-fund
COPY client ./
RUN npm run build

FROM python:3.11.13-slim AS metanerf
# its home is the one place where it may write: kernels are compiled into a cache there
# libgl1 and libegl1: MediaPipe loads them; curl: the health check
RUN apt-get update && apt-get install -y --no-install-recommends libgl1 libegl1 libglib2.0-0 libgomp1 curl \
    && rm -rf /var/lib/apt/lists/* && useradd --no-create-home --home-dir /data --uid 10001 metanerf
WORKDIR /app
COPY requirements.lock pyproject.toml README.md LICENSE NOTICE ./
# torch by version alone: its builds differ from machine to machine
RUN pip install --no-cache-dir torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu \
    && pip install --no-cache-dir --no-deps --require-hashes -r requirements.lock
COPY scene scene
COPY db db
COPY capture capture
COPY renderer renderer
COPY services services
COPY benchmarks benchmarks
RUN pip install --no-cache-dir --no-deps --no-build-isolation -e .
COPY --from=page /client/dist client/dist
RUN mkdir /data && chown metanerf /data
USER metanerf
ENV METANERF_DATA_DIR=/data METANERF_CLIENT_DIR=/app/client/dist METANERF_HOST=0.0.0.0
EXPOSE 8000
CMD ["metanerf", "serve"]

FROM metanerf AS gpu
USER root
# gcc: Triton compiles its launchers with it
RUN apt-get update && apt-get install -y --no-install-recommends gcc libc6-dev && rm -rf /var/lib/apt/lists/* \
    && pip install --no-cache-dir --force-reinstall torch==2.13.0
USER metanerf

FROM metanerf AS cluster
USER root
COPY requirements-cluster.lock ./
RUN pip install --no-cache-dir --no-deps --require-hashes -r requirements-cluster.lock
USER metanerf

# what is built where nobody names a stage
FROM metanerf
