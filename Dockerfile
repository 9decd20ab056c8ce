# docker build -t vsalog . && docker run --rm -v "$PWD:/data" --user "$(id -u):$(id -g)" vsalog estimate exp1.mcap
FROM python:3.12-slim AS build
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY vsalog vsalog
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.12-slim
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels \
    pip install --no-cache-dir --no-compile /wheels/*.whl \
    && useradd --create-home vsalog
# Compiled loops are kept here, also by a user without a home.
ENV NUMBA_CACHE_DIR=/tmp/numba
USER vsalog
WORKDIR /data
ENTRYPOINT ["vsalog"]
CMD ["--help"]
