using System;

namespace Terraport
{
    /// <summary>
    /// XXH3-64 with seed 0 (Y. Collet, https://github.com/Cyan4973/xxHash): the hash of every file and payload of a scene.
    /// </summary>
    /// <remarks>
    /// Pointers, since every payload is hashed before it is used, and an array's accesses are checked one by one otherwise. The
    /// range is checked once, before the first read; numbers are read as they lie in memory, which is little-endian on every
    /// platform that Unity builds for; not on 8-byte borders, which 32-bit ARM (ARMv7) does not allow.
    /// </remarks>
    public static unsafe class Xxh3
    {
        private const ulong Prime32A = 0x9E3779B1;
        private const ulong Prime32B = 0x85EBCA77;
        private const ulong Prime32C = 0xC2B2AE3D;
        private const ulong Prime64A = 0x9E3779B185EBCA87;
        private const ulong Prime64B = 0xC2B2AE3D27D4EB4F;
        private const ulong Prime64C = 0x165667B19E3779F9;
        private const ulong Prime64D = 0x85EBCA77C2B2AE63;
        private const ulong Prime64E = 0x27D4EB2F165667C5;
        private const ulong MixA = 0x165667919E3779F9;
        private const ulong MixB = 0x9FB21C651E98DF25;
        private const int StripeBytes = 64;
        private const int StripesPerBlock = 16;
        private const int BlockBytes = StripeBytes * StripesPerBlock;

        /// <summary>The 192 bytes of the standard secret, as little-endian words.</summary>
        private static readonly ulong[] SecretWords = {
            0xBE4BA423396CFEB8,
            0x1CAD21F72C81017C,
            0xDB979083E96DD4DE,
            0x1F67B3B7A4A44072,
            0x78E5C0CC4EE679CB,
            0x2172FFCC7DD05A82,
            0x8E2443F7744608B8,
            0x4C263A81E69035E0,
            0xCB00C391BB52283C,
            0xA32E531B8B65D088,
            0x4EF90DA297486471,
            0xD8ACDEA946EF1938,
            0x3F349CE33F76FAA8,
            0x1D4F0BC7C7BBDCF9,
            0x3159B4CD4BE0518A,
            0x647378D9C97E9FC8,
            0xC3EBD33483ACC5EA,
            0xEB6313FAFFA081C5,
            0x49DAF0B751DD0D17,
            0x9E68D429265516D3,
            0xFCA1477D58BE162B,
            0xCE31D07AD1B8F88F,
            0x280416958F3ACB45,
            0x7E404BBBCAFBD7AF,
        };

        /// <summary>Hash of a whole array; allocates nothing.</summary>
        public static ulong Hash64(byte[] bytes)
        {
            if (bytes == null)
            {
                throw new ArgumentNullException("bytes");
            }
            return Hash64(bytes, 0, bytes.Length);
        }

        /// <summary>Hash of a range of an array; allocates nothing.</summary>
        /// <exception cref="ArgumentOutOfRangeException">The range does not lie within the array.</exception>
        public static ulong Hash64(byte[] bytes, int offset, int length)
        {
            if (bytes == null)
            {
                throw new ArgumentNullException("bytes");
            }
            if (offset < 0 || length < 0 || length > bytes.Length - offset)
            {
                throw new ArgumentOutOfRangeException("length", length + " bytes from " + offset + ", expected within " + bytes.Length);
            }
            fixed(byte *start = bytes) fixed(ulong *words = SecretWords)
            {
                // An empty array has no first byte to point to; none is read then.
                byte *input = start + offset;
                byte *secret = (byte *)words;
                if (length <= 16)
                {
                    return Short(input, length, secret);
                }
                if (length <= 128)
                {
                    return UpTo128(input, length, secret);
                }
                return length <= 240 ? UpTo240(input, length, secret) : Long(input, length, secret);
            }
        }

        /// <summary>0 to 16 bytes: one formula for each of 9 to 16, 4 to 8, 1 to 3, and none.</summary>
        private static ulong Short(byte *input, int length, byte *secret)
        {
            unchecked
            {
                if (length > 8)
                {
                    ulong low = *(ulong *)input ^ *(ulong *)(secret + 24) ^ *(ulong *)(secret + 32);
                    ulong high = *(ulong *)(input + length - 8) ^ *(ulong *)(secret + 40) ^ *(ulong *)(secret + 48);
                    return Avalanche((ulong)length + Swapped(low) + high + MultiplyFold(low, high));
                }
                if (length >= 4)
                {
                    ulong both = *(uint *)(input + length - 4) + ((ulong) * (uint *)input << 32);
                    ulong hash = both ^ *(ulong *)(secret + 8) ^ *(ulong *)(secret + 16);
                    hash ^= Rotated(hash, 49) ^ Rotated(hash, 24);
                    hash *= MixB;
                    hash ^= (hash >> 35) + (ulong)length;
                    hash *= MixB;
                    return hash ^ (hash >> 28);
                }
                if (length > 0)
                {
                    uint three = ((uint)input[0] << 16) | ((uint)input[length >> 1] << 24) | input[length - 1] | ((uint)length << 8);
                    return OldAvalanche(three ^ (ulong)(*(uint *)secret ^ *(uint *)(secret + 4)));
                }
                return OldAvalanche(*(ulong *)(secret + 56) ^ *(ulong *)(secret + 64));
            }
        }

        /// <summary>17 to 128 bytes.</summary>
        private static ulong UpTo128(byte *input, int length, byte *secret)
        {
            unchecked
            {
                // 17 to 128 bytes: pairs of 16 bytes from both ends towards the middle, which may overlap there.
                ulong sum = (ulong)length * Prime64A;
                for (int pair = (length - 1) / 32; pair >= 0; pair--)
                {
                    sum += Mix16(input + 16 * pair, secret + 32 * pair);
                    sum += Mix16(input + length - 16 * (pair + 1), secret + 32 * pair + 16);
                }
                return Avalanche(sum);
            }
        }

        /// <summary>129 to 240 bytes.</summary>
        private static ulong UpTo240(byte *input, int length, byte *secret)
        {
            unchecked
            {
                // 129 to 240 bytes: 16 at a time; the secret's offsets 3 and 17 are those of the reference implementation.
                ulong sum = (ulong)length * Prime64A;
                for (int at = 0; at < 8; at++)
                {
                    sum += Mix16(input + 16 * at, secret + 16 * at);
                }
                sum = Avalanche(sum);
                for (int at = 8; at < length / 16; at++)
                {
                    sum += Mix16(input + 16 * at, secret + 16 * (at - 8) + 3);
                }
                return Avalanche(sum + Mix16(input + length - 16, secret + 136 - 17));
            }
        }

        /// <summary>Above 240 bytes: blocks of 16 stripes, scrambled after each.</summary>
        private static ulong Long(byte *input, int length, byte *secret)
        {
            unchecked
            {
                ulong *sums = stackalloc ulong[8];
                // Eight accumulators with the reference's start values.
                sums[0] = Prime32C;
                sums[1] = Prime64A;
                sums[2] = Prime64B;
                sums[3] = Prime64C;
                sums[4] = Prime64D;
                sums[5] = Prime32B;
                sums[6] = Prime64E;
                sums[7] = Prime32A;
                // length - 1: the last stripe is always taken by the line for the end, also where blocks divide the input.
                int blocks = (length - 1) / BlockBytes;
                for (int block = 0; block < blocks; block++)
                {
                    Accumulate(sums, input + block * BlockBytes, secret, StripesPerBlock);
                    for (int lane = 0; lane < 8; lane++)
                    {
                        ulong sum = sums[lane];
                        sums[lane] = (sum ^ (sum >> 47) ^ ((ulong *)(secret + 128))[lane]) * Prime32A;
                    }
                }
                int remainingStripes = (length - 1 - blocks * BlockBytes) / StripeBytes;
                Accumulate(sums, input + blocks * BlockBytes, secret, remainingStripes);
                // The last 64 bytes once more, over some that were taken already: no tail needs a loop of its own.
                Accumulate(sums, input + length - StripeBytes, secret + 121, 1);
                ulong hash = (ulong)length * Prime64A;
                for (int pair = 0; pair < 4; pair++)
                {
                    ulong *key = (ulong *)(secret + 11 + 16 * pair);
                    hash += MultiplyFold(sums[2 * pair] ^ key[0], sums[2 * pair + 1] ^ key[1]);
                }
                return Avalanche(hash);
            }
        }

        /// <summary>Each stripe has 64 bytes, and its secret starts 8 bytes after that of the one before.</summary>
        private static void Accumulate(ulong *sums, byte *input, byte *secret, int stripes)
        {
            unchecked
            {
                // Locals, so that they can stay in registers: memory behind a pointer might be the input's.
                ulong a = sums[0], b = sums[1], c = sums[2], d = sums[3], e = sums[4], f = sums[5], g = sums[6], h = sums[7];
                for (int stripe = 0; stripe < stripes; stripe++)
                {
                    ulong *value = (ulong *)(input + stripe * StripeBytes);
                    ulong *key = (ulong *)(secret + stripe * 8);
                    ulong x = value[0] ^ key[0];
                    ulong y = value[1] ^ key[1];
                    // Each lane adds its neighbour's raw word: an input word that meets a secret of the same value must not vanish.
                    a += value[1] + (uint)x * (x >> 32);
                    b += value[0] + (uint)y * (y >> 32);
                    x = value[2] ^ key[2];
                    y = value[3] ^ key[3];
                    c += value[3] + (uint)x * (x >> 32);
                    d += value[2] + (uint)y * (y >> 32);
                    x = value[4] ^ key[4];
                    y = value[5] ^ key[5];
                    e += value[5] + (uint)x * (x >> 32);
                    f += value[4] + (uint)y * (y >> 32);
                    x = value[6] ^ key[6];
                    y = value[7] ^ key[7];
                    g += value[7] + (uint)x * (x >> 32);
                    h += value[6] + (uint)y * (y >> 32);
                }
                sums[0] = a;
                sums[1] = b;
                sums[2] = c;
                sums[3] = d;
                sums[4] = e;
                sums[5] = f;
                sums[6] = g;
                sums[7] = h;
            }
        }

        /// <summary>16 bytes of input with 16 of the secret.</summary>
        private static ulong Mix16(byte *input, byte *secret)
        {
            ulong *value = (ulong *)input;
            ulong *key = (ulong *)secret;
            return MultiplyFold(value[0] ^ key[0], value[1] ^ key[1]);
        }

        /// <summary>The two halves of the 128-bit product, by exclusive or.</summary>
        private static ulong MultiplyFold(ulong left, ulong right)
        {
            unchecked
            {
                // Schoolbook product by halves: Math.BigMul for 64 bits is missing in .NET Standard 2.1.
                ulong lowLow = (ulong)(uint)left * (uint)right;
                ulong highLow = (left >> 32) * (uint)right;
                ulong lowHigh = (uint)left * (right >> 32);
                ulong highHigh = (left >> 32) * (right >> 32);
                ulong cross = (lowLow >> 32) + (uint)highLow + lowHigh;
                ulong upper = (highLow >> 32) + (cross >> 32) + highHigh;
                ulong lower = (cross << 32) | (uint)lowLow;
                return upper ^ lower;
            }
        }

        /// <summary>Spread every input bit over all output bits.</summary>
        private static ulong Avalanche(ulong hash)
        {
            unchecked
            {
                hash ^= hash >> 37;
                hash *= MixA;
                return hash ^ (hash >> 32);
            }
        }

        /// <summary>The final mix of XXH64, which XXH3 keeps for its shortest inputs.</summary>
        private static ulong OldAvalanche(ulong hash)
        {
            unchecked
            {
                hash ^= hash >> 33;
                hash *= Prime64B;
                hash ^= hash >> 29;
                hash *= Prime64C;
                return hash ^ (hash >> 32);
            }
        }

        private static ulong Rotated(ulong value, int bits) { return (value << bits) | (value >> (64 - bits)); }

        private static ulong Swapped(ulong value)
        {
            value = ((value & 0x00FF00FF00FF00FF) << 8) | ((value >> 8) & 0x00FF00FF00FF00FF);
            value = ((value & 0x0000FFFF0000FFFF) << 16) | ((value >> 16) & 0x0000FFFF0000FFFF);
            return (value << 32) | (value >> 32);
        }
    }
}
