#include "TerraportTexture.h"

#include "Core/Ktx2.h"
#include "Engine/Texture2D.h"
#include "IImageWrapperModule.h"
#include "ImageCore.h"
#include "Modules/ModuleManager.h"
#include "PixelFormat.h"
#include "TextureResource.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace TerraportTexture
{
namespace
{
/** Linear light of the 256 levels (IEC 61966-2-1), in 16 bits: what means are taken of. */
const std::array<uint16, 256>& LinearLevels()
{
	static const std::array<uint16, 256> Levels = [] {
		std::array<uint16, 256> Out{};
		for (std::size_t Level = 0; Level < Out.size(); ++Level)
		{
			const double Share = double(Level) / 255.0;
			const double Light = Share <= 0.04045 ? Share / 12.92 : std::pow((Share + 0.055) / 1.055, 2.4);
			Out[Level] = uint16(Light * 65535.0 + 0.5);
		}
		return Out;
	}();
	return Levels;
}

/** The nearest level of linear light. */
uint8 SrgbOf(uint16 Light)
{
	static const std::vector<uint8> Levels = [] {
		const std::array<uint16, 256>& Linear = LinearLevels();
		std::vector<uint8> Out(65536);
		std::size_t Level = 0;
		for (std::size_t Code = 0; Code < Out.size(); ++Code)
		{
			while (Level < 255 && 2 * Code > std::size_t(Linear[Level]) + Linear[Level + 1])
			{
				++Level;
			}
			Out[Code] = uint8(Level);
		}
		return Out;
	}();
	return Levels[Light];
}

/** Four pixels to one. Where a side is 1 already, two. */
TArray64<uint8> HalfOf(const TArray64<uint8>& From, int32 Width, int32 Height)
{
	const std::array<uint16, 256>& Linear = LinearLevels();
	const int32 OutWidth = std::max(Width / 2, 1), OutHeight = std::max(Height / 2, 1);
	TArray64<uint8> Out;
	Out.SetNumUninitialized(int64(OutWidth) * OutHeight * 4);
	for (int32 Row = 0; Row < OutHeight; ++Row)
	{
		const int64 Upper = int64(std::min(2 * Row, Height - 1)) * Width;
		const int64 Lower = int64(std::min(2 * Row + 1, Height - 1)) * Width;
		for (int32 Column = 0; Column < OutWidth; ++Column)
		{
			const int64 Left = std::min(2 * Column, Width - 1), Right = std::min(2 * Column + 1, Width - 1);
			const int64 Corners[4] = {4 * (Upper + Left), 4 * (Upper + Right), 4 * (Lower + Left), 4 * (Lower + Right)};
			const int64 To = 4 * (int64(Row) * OutWidth + Column);
			for (int64 Channel = 0; Channel < 3; ++Channel)
			{
				uint32 Sum = 0;
				for (const int64 Corner : Corners)
				{
					Sum += Linear[From[Corner + Channel]];
				}
				Out[To + Channel] = SrgbOf(uint16((Sum + 2) / 4));
			}
			Out[To + 3] = 255;
		}
	}
	return Out;
}
} // namespace

uint16 LinearOf(uint8 Level)
{
	return LinearLevels()[Level];
}

void MakeMips(FTerraportPixels& Pixels)
{
	int32 Width = Pixels.Width, Height = Pixels.Height;
	while (Width > 1 || Height > 1)
	{
		Pixels.Mips.push_back(HalfOf(Pixels.Mips.back(), Width, Height));
		Width = std::max(Width / 2, 1);
		Height = std::max(Height / 2, 1);
	}
}

namespace
{
/** Blocks of four by four texels: the engine makes no smaller texture of them. */
constexpr std::uint32_t BlockSide = 4;

FTerraportPixels DecodeBlocks(const terraport::SegmentImage& Image, terraport::ByteSpan Payload)
{
	FTerraportPixels Pixels;
	const bool bDesktop = GPixelFormats[PF_DXT1].Supported;
	if ((!bDesktop && !GPixelFormats[PF_ETC2_RGB].Supported) || Image.width < BlockSide || Image.height < BlockSide)
	{
		return Pixels;
	}
	std::vector<terraport::BlockLevel> Levels;
	const terraport::BlockForm Form = bDesktop ? terraport::BlockForm::Bc1 : terraport::BlockForm::Etc1;
	if (!terraport::decodeKtx2(Image.fileOf(Payload), Form, Levels).isOk())
	{
		return Pixels;
	}
	Pixels.Format = bDesktop ? PF_DXT1 : PF_ETC2_RGB;
	Pixels.Width = int32(Image.width);
	Pixels.Height = int32(Image.height);
	for (const terraport::BlockLevel& Level : Levels)
	{
		TArray64<uint8> Blocks;
		Blocks.SetNumUninitialized(int64(Level.blocks.size()));
		FMemory::Memcpy(Blocks.GetData(), Level.blocks.data(), SIZE_T(Level.blocks.size()));
		Pixels.Mips.push_back(MoveTemp(Blocks));
	}
	return Pixels;
}
} // namespace

FTerraportPixels Decode(const terraport::SegmentImage& Image, terraport::ByteSpan Payload)
{
	if (Image.kind == terraport::ImageKind::Ktx2)
	{
		return DecodeBlocks(Image, Payload);
	}
	FTerraportPixels Pixels;
	if (Image.kind != terraport::ImageKind::Jpeg && Image.kind != terraport::ImageKind::Png)
	{
		return Pixels;
	}
	// Loaded when the scene was opened: a worker may only look it up.
	IImageWrapperModule* Module = FModuleManager::GetModulePtr<IImageWrapperModule>(TEXT("ImageWrapper"));
	FImage Raw;
	if (Module == nullptr || !Module->DecompressImage(Image.fileOf(Payload).data, int64(Image.bytes), Raw))
	{
		return Pixels;
	}
	// The sides were bounded by the decoder, which read them in the header; an image that decodes to others lied.
	if (Raw.SizeX != int64(Image.width) || Raw.SizeY != int64(Image.height))
	{
		return Pixels;
	}
	Raw.ChangeFormat(ERawImageFormat::BGRA8, EGammaSpace::sRGB);
	if (Raw.RawData.Num() != int64(Image.width) * int64(Image.height) * 4)
	{
		return Pixels;
	}
	Pixels.Width = int32(Image.width);
	Pixels.Height = int32(Image.height);
	Pixels.Mips.push_back(MoveTemp(Raw.RawData));
	MakeMips(Pixels);
	return Pixels;
}

UTexture2D* MakeTexture(FTerraportPixels& Pixels)
{
	if (Pixels.IsEmpty())
	{
		return nullptr;
	}
	UTexture2D* Texture = UTexture2D::CreateTransient(Pixels.Width, Pixels.Height, Pixels.Format);
	if (Texture == nullptr)
	{
		return nullptr;
	}
	Texture->SRGB = true;
	Texture->NeverStream = true;
	// Charts must not bleed over the image's border (scene format, section 9).
	Texture->AddressX = TA_Clamp;
	Texture->AddressY = TA_Clamp;
	Texture->Filter = TF_Trilinear;
	FTexturePlatformData* Data = Texture->GetPlatformData();
	int32 Width = Pixels.Width, Height = Pixels.Height;
	for (std::size_t Level = 0; Level < Pixels.Mips.size(); ++Level)
	{
		// CreateTransient made the first one.
		if (Level > 0)
		{
			FTexture2DMipMap* Mip = new FTexture2DMipMap();
			Mip->SizeX = Width;
			Mip->SizeY = Height;
			Data->Mips.Add(Mip);
		}
		FByteBulkData& Bulk = Data->Mips[int32(Level)].BulkData;
		Bulk.Lock(LOCK_READ_WRITE);
		void* To = Bulk.Realloc(Pixels.Mips[Level].Num());
		FMemory::Memcpy(To, Pixels.Mips[Level].GetData(), SIZE_T(Pixels.Mips[Level].Num()));
		Bulk.Unlock();
		Width = std::max(Width / 2, 1);
		Height = std::max(Height / 2, 1);
	}
	Pixels = FTerraportPixels();
	Texture->UpdateResource();
	return Texture;
}
} // namespace TerraportTexture
