using System;
using Terraport.Json;

namespace Terraport
{
    /// <summary>
    /// The two chunks of a GLB (glTF 2.0, section 4.4), and values out of its document, each checked before it is used.
    /// </summary>
    internal sealed class GlbDocument
    {
        /// <summary>Bounds the parser's work on hostile bytes; our own documents have 2 to 4 KiB.</summary>
        private const int MaxJsonBytes = 1 << 20;
        private const int HeaderBytes = 12;
        private const int ChunkBytes = 8;
        // "glTF", "JSON" and "BIN\\0" as little-endian numbers.
        private const uint Gltf = 0x46546C67;
        private const uint JsonChunk = 0x4E4F534A;
        private const uint BinaryChunk = 0x004E4942;
        private int payloadStart;

        internal GlbDocument() { Tape = new JsonTape(); }

        /// <summary>The document; its root is node 0, an object.</summary>
        internal JsonTape Tape { get; private set; }

        /// <summary>The array that the payload lies in.</summary>
        internal byte[] Bytes { get; private set; }

        /// <summary>Where the contents of the BIN chunk start in <see cref="Bytes"/>.</summary>
        internal int BinaryStart { get; private set; }

        /// <summary>Length of the BIN chunk's contents, bytes.</summary>
        internal int BinaryLength { get; private set; }

        /// <summary>Read both chunks; nothing inside the document is checked yet.</summary>
        /// <exception cref="PayloadException">With the offset: magic, version, length, chunks, JSON.</exception>
        internal void Read(ArraySegment<byte> payload)
        {
            int size = payload.Count;
            payloadStart = payload.Offset;
            Bytes = payload.Array;
            // 1. Header: magic, version, length. Its length must be the payload's own, so that nothing hides behind it.
            if (size < HeaderBytes + ChunkBytes)
            {
                throw new PayloadException(size + " bytes, expected a GLB of at least " + (HeaderBytes + ChunkBytes), 0);
            }
            if (Word(0) != Gltf)
            {
                throw new PayloadException("no magic glTF at the start", 0);
            }
            if (Word(4) != 2)
            {
                throw new PayloadException("glTF version " + Word(4) + ", expected 2", 4);
            }
            if (Word(8) != (uint)size)
            {
                throw new PayloadException(size + " bytes, expected " + Word(8) + " by the header", 8);
            }
            // 2. The two chunks, in this order, and nothing after them.
            int jsonLength = ChunkAt(HeaderBytes, size, JsonChunk, "JSON");
            if (jsonLength > MaxJsonBytes)
            {
                throw new PayloadException("JSON chunk of " + jsonLength + " bytes, expected at most " + MaxJsonBytes, HeaderBytes);
            }
            int jsonStart = HeaderBytes + ChunkBytes;
            BinaryLength = ChunkAt(jsonStart + jsonLength, size, BinaryChunk, "BIN");
            int binaryStart = jsonStart + jsonLength + ChunkBytes;
            if (binaryStart + BinaryLength != size)
            {
                throw new PayloadException("something after the BIN chunk, expected nothing", binaryStart + BinaryLength);
            }
            // 3. The document. Offsets in errors count from the payload, not from the array that it lies in.
            BinaryStart = payloadStart + binaryStart;
            try
            {
                Tape.Read(Bytes, payloadStart + jsonStart, jsonLength);
            }
            catch (JsonException error)
            {
                throw new PayloadException("JSON does not parse: " + error.Reason, OffsetOf(error.Offset));
            }
            ExpectObject(0, "JSON chunk", null);
        }

        /// <summary>Drop the references to the payload: it belongs to a pool, and this object outlives it.</summary>
        internal void Release()
        {
            Bytes = null;
            Tape.Release();
        }

        /// <summary>Offset in the payload of an index into <see cref="Bytes"/>, for error texts.</summary>
        internal long OffsetOf(int index) { return index - payloadStart; }

        /// <summary>
        /// The node, if it is an object. The label says whose property it is and may be null; texts are built for errors alone.
        /// </summary>
        internal int ExpectObject(int node, string property, string label)
        {
            if (!Tape.IsObject(node))
            {
                throw Wrong(node, property, label, "an object");
            }
            return node;
        }

        /// <summary>The node, if it is a list.</summary>
        internal int ExpectList(int node, string property)
        {
            if (!Tape.IsList(node))
            {
                throw Wrong(node, property, null, "a list");
            }
            return node;
        }

        /// <summary>The object under a key, or <see cref="JsonTape.None"/> where the key is absent.</summary>
        internal int OptionalObject(int owner, string key)
        {
            if (owner < 0)
            {
                return JsonTape.None;
            }
            int node = Tape.Find(owner, key);
            return node < 0 ? node : ExpectObject(node, key, null);
        }

        /// <summary>Node under a key; none where there is no owner.</summary>
        internal int Find(int owner, string key) { return owner < 0 ? JsonTape.None : Tape.Find(owner, key); }

        /// <summary>The object in a list under a key that must hold exactly one.</summary>
        internal int Single(int owner, string key)
        {
            int list = ExpectList(Tape.Find(owner, key), key);
            if (Tape.CountOf(list) != 1)
            {
                throw new PayloadException(Tape.CountOf(list) + " " + key + ", expected 1");
            }
            return ExpectObject(Tape.FirstOf(list), key, null);
        }

        /// <summary>The object of a list under the root, by a node that holds its number.</summary>
        internal int Pick(string listKey, int numberNode, string property, string label)
        {
            int list = ExpectList(Tape.Find(0, listKey), listKey);
            double number = Tape.IsNumber(numberNode) ? Tape.NumberOf(numberNode) : -1;
            if (number >= 0 && number < Tape.CountOf(list) && number == Math.Floor(number))
            {
                return ExpectObject(Tape.Entry(list, (int)number), property, label);
            }
            throw Wrong(numberNode, property, label, "0 to " + (Tape.CountOf(list) - 1));
        }

        /// <summary>A whole number of at least <paramref name="min"/>, below 2^31.</summary>
        internal int ExpectWhole(int node, string property, string label, int min)
        {
            double value = Tape.IsNumber(node) ? Tape.NumberOf(node) : double.NaN;
            if (value >= min && value <= int.MaxValue && value == Math.Floor(value))
            {
                return (int)value;
            }
            throw Wrong(node, property, label, "a whole number of at least " + min);
        }

        /// <summary>The node's value, if it is a finite number.</summary>
        internal double ExpectFinite(int node, string property, string label)
        {
            double value = Tape.IsNumber(node) ? Tape.NumberOf(node) : double.NaN;
            // False for NaN and for both infinities.
            if (value - value == 0)
            {
                return value;
            }
            throw Wrong(node, property, label, "a finite number");
        }

        /// <summary>Three finite numbers, or what they are without the key.</summary>
        internal Vec3 Triple(int owner, string key, double absent)
        {
            int node = Tape.Find(owner, key);
            if (node < 0)
            {
                return new Vec3(absent, absent, absent);
            }
            ExpectList(node, key);
            if (Tape.CountOf(node) != 3)
            {
                throw Wrong(node, key, null, "three numbers");
            }
            int x = Tape.FirstOf(node);
            int y = Tape.After(x);
            int z = Tape.After(y);
            return new Vec3(ExpectFinite(x, key, null), ExpectFinite(y, key, null), ExpectFinite(z, key, null));
        }

        /// <summary>An error that says what a node is and what was expected; thrown by the caller.</summary>
        internal PayloadException Wrong(int node, string property, string label, string expected)
        {
            string name = label == null ? property : property + " of " + label;
            return new PayloadException(name + " is " + Tape.Describe(node) + ", expected " + expected);
        }

        private uint Word(int at)
        {
            int index = payloadStart + at;
            return Bytes[index] | ((uint)Bytes[index + 1] << 8) | ((uint)Bytes[index + 2] << 16) | ((uint)Bytes[index + 3] << 24);
        }

        /// <summary>Length of the contents of the chunk that starts at <paramref name="at"/>; it ends within the payload.</summary>
        private int ChunkAt(int at, int size, uint kind, string name)
        {
            int remaining = size - at - ChunkBytes;
            if (remaining < 0)
            {
                throw new PayloadException(remaining + ChunkBytes + " bytes left, expected a " + name + " chunk", at);
            }
            if (Word(at + 4) != kind)
            {
                throw new PayloadException("chunk type " + Word(at + 4) + ", expected " + name, at + 4);
            }
            // Unsigned, before any addition: a length near 2^32 must not wrap around.
            if (Word(at) > (uint)remaining)
            {
                throw new PayloadException("chunk of " + Word(at) + " bytes, " + remaining + " left", at);
            }
            return (int)Word(at);
        }
    }
}
