"""Thin wrappers of OpenGL objects: shader programs, vertex buffers, textures, framebuffers."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyglet import gl
from pyglet.graphics.shader import Shader, ShaderProgram

from itouch_tools.viewer.solids import Solid


class Program:
    """A shader program, with the locations of its uniforms."""

    def __init__(self, vertex: str, fragment: str) -> None:
        self._program = ShaderProgram(Shader(vertex, "vertex"), Shader(fragment, "fragment"))
        self.id = self._program.id
        self._places: dict[str, int] = {}

    def use(self) -> None:
        """Make it the current program."""
        gl.glUseProgram(self.id)

    def place(self, name: str) -> int:
        """Return the location of a uniform."""
        if name not in self._places:
            self._places[name] = gl.glGetUniformLocation(self.id, ctypes.create_string_buffer(name.encode()))
        return self._places[name]

    def attribute(self, name: str) -> int:
        """Return the location of a vertex attribute, -1 if the program does not use it."""
        return int(gl.glGetAttribLocation(self.id, ctypes.create_string_buffer(name.encode())))

    def matrix(self, name: str, value: NDArray[np.float64]) -> None:
        """Set a matrix, (3, 3) or (4, 4), in row order: dimensionless except for a displacement [m] or [pixels]."""
        flat = np.ascontiguousarray(value, np.float32)
        pointer = flat.ctypes.data_as(ctypes.POINTER(ctypes.c_float))
        set_matrix = gl.glUniformMatrix4fv if len(value) == 4 else gl.glUniformMatrix3fv
        set_matrix(self.place(name), 1, gl.GL_TRUE, pointer)

    def vector(self, name: str, *values: float) -> None:
        """Set a vector of 3 or 4 numbers, or a single number."""
        setter = {1: gl.glUniform1f, 3: gl.glUniform3f, 4: gl.glUniform4f}[len(values)]
        setter(self.place(name), *values)

    def unit(self, name: str, number: int) -> None:
        """Bind a sampler to a texture unit."""
        gl.glUniform1i(self.place(name), number)


class Triangles:
    """A solid in graphics memory, laid out for the attributes ``position`` and ``normal`` of one program."""

    def __init__(self, solid: Solid, program: Program) -> None:
        self._array, self._points, self._normals, self._faces = _names(gl.glGenVertexArrays, 1) + _names(
            gl.glGenBuffers, 3
        )
        self.count = int(solid.faces.size)
        gl.glBindVertexArray(self._array)
        _upload(gl.GL_ARRAY_BUFFER, self._points, solid.positions)
        _attribute(program.attribute("position"), 3, 0, 0)
        _upload(gl.GL_ARRAY_BUFFER, self._normals, solid.normals)
        _attribute(program.attribute("normal"), 3, 0, 0)
        _upload(gl.GL_ELEMENT_ARRAY_BUFFER, self._faces, solid.faces)
        gl.glBindVertexArray(0)

    def draw(self) -> None:
        """Draw it with the current program."""
        gl.glBindVertexArray(self._array)
        gl.glDrawElements(gl.GL_TRIANGLES, self.count, gl.GL_UNSIGNED_INT, None)


class Paint:
    """Coloured vertices that are uploaded again for each draw: lines and filled triangles of grid and charts."""

    def __init__(self, program: Program) -> None:
        self._program = program
        (self._array,), (self._buffer,) = _names(gl.glGenVertexArrays, 1), _names(gl.glGenBuffers, 1)
        gl.glBindVertexArray(self._array)
        gl.glBindBuffer(gl.GL_ARRAY_BUFFER, self._buffer)
        stride = 7 * 4
        _attribute(program.attribute("position"), 3, stride, 0)
        _attribute(program.attribute("tint"), 4, stride, 12)
        gl.glBindVertexArray(0)

    def draw(self, kind: int, vertices: NDArray[np.float32], seen: NDArray[np.float64]) -> None:
        """Draw vertices (n, 7) as GL_LINES, GL_LINE_STRIP or GL_TRIANGLES.

        A row has a position, in the unit that ``seen`` takes ([m] or [pixels]), and a colour: red, green, blue and
        opacity, 0 to 1.  ``seen`` (4, 4) transforms positions to the clip space of OpenGL.
        """
        if not len(vertices):
            return
        self._program.use()
        self._program.matrix("seen", seen)
        gl.glBindVertexArray(self._array)
        _upload(gl.GL_ARRAY_BUFFER, self._buffer, np.ascontiguousarray(vertices, np.float32), gl.GL_STREAM_DRAW)
        gl.glDrawArrays(kind, 0, len(vertices))
        gl.glBindVertexArray(0)


class ShadowMap:
    """A square depth texture into which the sun's view is drawn."""

    def __init__(self, size: int = 896) -> None:
        self.size = size
        (self.texture,), (self._frame,) = _names(gl.glGenTextures, 1), _names(gl.glGenFramebuffers, 1)
        gl.glBindTexture(gl.GL_TEXTURE_2D, self.texture)
        gl.glTexImage2D(
            gl.GL_TEXTURE_2D, 0, gl.GL_DEPTH_COMPONENT24, size, size, 0, gl.GL_DEPTH_COMPONENT, gl.GL_FLOAT, None
        )
        for name, value in (
            (gl.GL_TEXTURE_MIN_FILTER, gl.GL_NEAREST), (gl.GL_TEXTURE_MAG_FILTER, gl.GL_NEAREST),
            (gl.GL_TEXTURE_WRAP_S, gl.GL_CLAMP_TO_EDGE), (gl.GL_TEXTURE_WRAP_T, gl.GL_CLAMP_TO_EDGE),
        ):  # fmt: skip
            gl.glTexParameteri(gl.GL_TEXTURE_2D, name, value)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._frame)
        gl.glFramebufferTexture2D(gl.GL_FRAMEBUFFER, gl.GL_DEPTH_ATTACHMENT, gl.GL_TEXTURE_2D, self.texture, 0)
        gl.glDrawBuffer(gl.GL_NONE)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, 0)

    def begin(self) -> None:
        """Draw into it from now on."""
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._frame)
        gl.glViewport(0, 0, self.size, self.size)
        gl.glClear(gl.GL_DEPTH_BUFFER_BIT)


class HeightMap:
    """A texture of heights (rows, columns), 0 to 1, that repeats; its bottom row comes first."""

    def __init__(self, heights: NDArray[np.float32]) -> None:
        rows, columns = heights.shape
        (self.texture,) = _names(gl.glGenTextures, 1)
        gl.glBindTexture(gl.GL_TEXTURE_2D, self.texture)
        gl.glPixelStorei(gl.GL_UNPACK_ALIGNMENT, 1)
        pixels = heights.ctypes.data_as(ctypes.c_void_p)
        gl.glTexImage2D(gl.GL_TEXTURE_2D, 0, gl.GL_R32F, columns, rows, 0, gl.GL_RED, gl.GL_FLOAT, pixels)
        gl.glGenerateMipmap(gl.GL_TEXTURE_2D)
        for name, value in (
            (gl.GL_TEXTURE_MIN_FILTER, gl.GL_LINEAR_MIPMAP_LINEAR), (gl.GL_TEXTURE_MAG_FILTER, gl.GL_LINEAR),
            (gl.GL_TEXTURE_WRAP_S, gl.GL_REPEAT), (gl.GL_TEXTURE_WRAP_T, gl.GL_REPEAT),
        ):  # fmt: skip
            gl.glTexParameteri(gl.GL_TEXTURE_2D, name, value)


class Frame:
    """An off-screen, multisampled picture; ``blit`` copies it to a framebuffer, ``read`` returns its pixels."""

    def __init__(self, width: int, height: int, *, samples: int = 4) -> None:
        self.width, self.height = width, height
        limit = (ctypes.c_int * 1)()
        gl.glGetIntegerv(gl.GL_MAX_SAMPLES, limit)
        self._samples = min(samples, limit[0])
        self._many, self._one = _names(gl.glGenFramebuffers, 2)
        self._colours, self._depth, self._plain = _names(gl.glGenRenderbuffers, 3)
        self._store(self._many, self._colours, self._samples)
        gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, self._depth)
        gl.glRenderbufferStorageMultisample(gl.GL_RENDERBUFFER, self._samples, gl.GL_DEPTH_COMPONENT24, width, height)
        gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, gl.GL_DEPTH_ATTACHMENT, gl.GL_RENDERBUFFER, self._depth)
        self._store(self._one, self._plain, 0)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, 0)

    def _store(self, frame: int, buffer: int, samples: int) -> None:
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, frame)
        gl.glBindRenderbuffer(gl.GL_RENDERBUFFER, buffer)
        gl.glRenderbufferStorageMultisample(gl.GL_RENDERBUFFER, samples, gl.GL_RGBA8, self.width, self.height)
        gl.glFramebufferRenderbuffer(gl.GL_FRAMEBUFFER, gl.GL_COLOR_ATTACHMENT0, gl.GL_RENDERBUFFER, buffer)

    def begin(self) -> None:
        """Draw into it from now on."""
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, self._many)
        gl.glViewport(0, 0, self.width, self.height)

    def blit(self, target: int = 0) -> None:
        """Copy it to a framebuffer of the same size; 0 is the window's."""
        gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, self._many)
        gl.glBindFramebuffer(gl.GL_DRAW_FRAMEBUFFER, target)
        size = (0, 0, self.width, self.height)
        gl.glBlitFramebuffer(*size, *size, gl.GL_COLOR_BUFFER_BIT, gl.GL_NEAREST)
        gl.glBindFramebuffer(gl.GL_FRAMEBUFFER, target)

    def read(self) -> NDArray[np.uint8]:
        """Return the pixels, shape (height, width, 3), top row first."""
        self.blit(self._one)
        pixels = np.empty((self.height, self.width, 4), np.uint8)
        gl.glPixelStorei(gl.GL_PACK_ALIGNMENT, 1)
        gl.glReadPixels(0, 0, self.width, self.height, gl.GL_RGBA, gl.GL_UNSIGNED_BYTE, pixels.ctypes.data)
        return np.ascontiguousarray(pixels[::-1, :, :3])

    def delete(self) -> None:
        """Free its memory."""
        gl.glDeleteFramebuffers(2, (ctypes.c_uint * 2)(self._many, self._one))
        gl.glDeleteRenderbuffers(3, (ctypes.c_uint * 3)(self._colours, self._depth, self._plain))


def _names(generate: Any, count: int) -> tuple[int, ...]:
    names = (ctypes.c_uint * count)()
    generate(count, names)
    return tuple(names)


def _upload(target: int, buffer: int, data: NDArray[Any], usage: int = gl.GL_STATIC_DRAW) -> None:
    gl.glBindBuffer(target, buffer)
    gl.glBufferData(target, data.nbytes, data.ctypes.data_as(ctypes.c_void_p), usage)


def _attribute(place: int, size: int, stride: int, offset: int) -> None:
    if place >= 0:
        gl.glEnableVertexAttribArray(place)
        gl.glVertexAttribPointer(place, size, gl.GL_FLOAT, gl.GL_FALSE, stride, ctypes.c_void_p(offset))
